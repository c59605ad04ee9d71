"""A control law of a user's own: its interface `Controller`, and how a vehicle file names it.

    [control]
    family = "module:Class"       # "cascade" if left out: hil/autonomy/control/controller.py
    depth = { p = 0.8, limit = 0.5 }

    [control.options]             # further arguments of the class

The class gets as keyword arguments `plant` (hil/autonomy/control/model.py), `gains`
(hil/autonomy/control/controller.py) and the keys of `[control.options]`.
"""

from math import isfinite, nan
from typing import Any, Protocol

from hil.autonomy.control.controller import NO_RESIDUAL, Gains, Navigation, VelocityCommand, Wrench
from hil.autonomy.control.model import Plant
from hil.common.errors import ConfigError
from hil.common.plugins import installed, load_class
from hil.common.schema import nearest


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
    """Return the user's controller named `family`; `control` is the `[control]` table, `where` begins error messages.

    Raises ConfigError for an unknown family, and for a wrong key of its options.
    """
    if not isinstance(family, str):
        raise ConfigError(f"{where}: family: expected text, found {family!r}")
    if ":" not in family and family not in (others := installed("controllers")):
        words = ["cascade", *others]
        raise ConfigError(
            f"{where}: family: {family!r} is not one of {', '.join(words)}{nearest(family, words)}; "
            'a class of your own is "module:Class"'
        )
    own = {**_table(control, "options", where), "class": family, "plant": plant, "gains": gains}
    return _Checked(load_class(own, Controller, where, "controllers"), family)


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
