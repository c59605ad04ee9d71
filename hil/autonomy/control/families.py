"""Control laws with one interface: `Controller`, and the table of names that select one.

    [control]
    family = "sliding_mode"       # "cascade" if left out
    depth = { p = 0.8, limit = 0.5 }

    [control.sliding_mode]        # all keys have defaults
    surge = { strength = 1.5 }

A user's own family is `family = "module:Class"`. The class gets as keyword arguments `plant`
(hil/autonomy/control/model.py), `gains` (hil/autonomy/control/controller.py) and the keys of `[control.options]`.
"""

from importlib import import_module
from math import isfinite, nan
from typing import Any, Protocol

from hil.autonomy.control.controller import NO_RESIDUAL, Gains, Navigation, VelocityCommand, Wrench
from hil.autonomy.control.model import Plant
from hil.common.errors import ConfigError
from hil.common.plugins import installed, load_class
from hil.common.schema import nearest, parse

# family -> class; its arguments are a Plant, the outer loops' Gains and its own `Settings`
FAMILIES = {
    "sliding_mode": "hil.autonomy.control.sliding_mode:SlidingMode",
    "restoring_pd": "hil.autonomy.control.restoring_pd:RestoringPd",
}


class Controller(Protocol):
    """Interface of a control law: from a velocity command to a wrench, one call in each control period.

    For any input the output is six finite numbers. It reads no clock, so the same calls give the same wrenches.
    """

    def reset(self) -> None:
        """Reset the state, after a pause or a change of controller."""

    def update(
        self, command: VelocityCommand, navigation: Navigation, dt: float, residual: Wrench = NO_RESIDUAL
    ) -> Wrench:
        """Return the wrench (X, Y, Z in N; K, M, N in N m; along FRD) for the next `dt` seconds, `dt` > 0.

        `residual` is what the allocator could not deliver of the last wrench (commanded minus delivered); integrators
        must not wind up against it.
        """


def make_controller(family: Any, control: dict[str, Any], gains: Gains, plant: Plant, where: str) -> Controller:
    """Return the controller named `family`; `control` is the `[control]` table, `where` begins error messages.

    Raises ConfigError for an unknown family, and for a wrong key of its table.
    """
    if not isinstance(family, str):
        raise ConfigError(f"{where}: family: expected text, found {family!r}")
    if ":" in family or (family not in FAMILIES and family in installed("controllers")):
        own = {**_table(control, "options", where), "class": family, "plant": plant, "gains": gains}
        return _Checked(load_class(own, Controller, where, "controllers"), family)
    if family not in FAMILIES:
        words = ["cascade", *FAMILIES]
        raise ConfigError(
            f"{where}: family: {family!r} is not one of {', '.join(words)}{nearest(family, words)}; "
            'a class of your own is "module:Class"'
        )
    module, _, name = FAMILIES[family].partition(":")
    kind = getattr(import_module(module), name)
    settings = parse(_table(control, family, where), kind.Settings, f"{where}.{family}")
    controller: Controller = kind(plant, gains, settings)
    return controller


class _Checked:
    """Wrapper of a user's own controller; it checks the wrenches."""

    def __init__(self, controller: Controller, name: str) -> None:
        self._controller, self._name = controller, name
        self.reset = controller.reset

    def update(
        self, command: VelocityCommand, navigation: Navigation, dt: float, residual: Wrench = NO_RESIDUAL
    ) -> Wrench:
        """Return the controller's wrench. Raises ConfigError if that is not six finite numbers."""
        wrench = self._controller.update(command, navigation, dt, residual)
        try:
            x, y, z, k, m, n = map(float, wrench)
        except (TypeError, ValueError):
            x = y = z = k = m = n = nan
        if not isfinite(x + y + z + k + m + n):
            raise ConfigError(f"{self._name}: update gave {wrench!r}: six finite numbers are needed, N and N m")
        return x, y, z, k, m, n


def _table(control: dict[str, Any], key: str, where: str) -> dict[str, Any]:
    table = control.get(key, {})
    if not isinstance(table, dict):
        raise ConfigError(f"{where}: {key}: expected a table, found {table!r}")
    return table
