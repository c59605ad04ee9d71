"""C versions of what every step computes, equal to Python to the last bit. sim/assembly.py and sim/twins.py select.

Public: `choose`, `load`, `NativeDynamics`. It must not compute anything that Python does not specify.

Each extension is one .c file that includes its headers, all in this folder:

    _native     a step, its forces and scalar sensors. Without Python: body, kernel, forces, surface, waves, errors. For
                Python: force_types, step_types, fused, sensor_types, impulses
    _rays       rays, rays_bundle, rays_mesh, rays_seabed, rays_tree
    _picture    a camera's light: shading, exposure, and the headers of _rays
    all         numbers, buffer, check_doubles

The environment variable `UUV_HIL_NATIVE=0` selects Python. With `UUV_HIL_NATIVE=1` a missing C extension is an error.
"""

import os
from collections.abc import Iterable, Sequence
from functools import lru_cache
from importlib import import_module
from random import Random
from struct import pack
from types import ModuleType
from typing import TYPE_CHECKING

from hil.common.errors import ConfigError
from sim.dynamics import Dynamics, State
from sim.sensors.error import ErrorBank, ErrorModel
from sim.vehicle.thrusters.bank import ThrusterSet
from sim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from sim.forces import Force
    from sim.native._native import Force as Twin
    from sim.vehicle.failures import Failure

SWITCH = "UUV_HIL_NATIVE"
REMEDY = "sudo apt install gcc python3-dev, then install uuv-hil again; in a clone: python c_extensions.py"
COMPILE_AGAIN = "install uuv-hil again; in a clone: python c_extensions.py"
ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))


class StaleExtensionError(ConfigError):
    """A C extension was compiled from other sources than this version's."""


class NativeDynamics(Dynamics):
    """`Dynamics` with its step in C. Raises ImportError if the extension is not compiled.

    The forces that sim/native/forces.py lists are in C, too. If there is any other force, all forces are computed in
    Python once a step, before the C.
    """

    def __init__(self, vehicle: Vehicle, density: float, gravity: float, forces: "Sequence[Force]" = ()) -> None:
        from sim.native._native import Kernel

        super().__init__(vehicle, density, gravity, forces)
        twins = _twins(forces)
        numbers = self.numbers()
        self.has_native_forces = twins is not None  # True if all additional forces are in C
        triangles = [x for triangle in self.hull.triangles for x in triangle]
        packed = pack(f"{len(numbers)}d", *numbers), pack(f"{len(triangles)}d", *triangles)
        self.kernel = Kernel(*packed, twins or ())
        self._advance = self.kernel.step if self.has_native_forces else self._step_with_python_forces

    def _step_with_python_forces(
        self, state: State, wrench: Sequence[float], current: Sequence[float], dt: float
    ) -> None:
        position, rotation, nu = self.kernel.predict_midpoint(state, dt)
        self.kernel.step(state, self.add_forces(position, rotation, nu, wrench, current), current, dt)


def _twins(forces: "Sequence[Force]") -> "tuple[Twin, ...] | None":
    """Return the C twins of `forces`, or None if one of them has no twin."""
    if not forces:
        return ()
    from sim.native._native import Force as Twin
    from sim.native.forces import make_twins

    return make_twins(forces, Twin)


class NativeThrusterSet(ThrusterSet):
    """`ThrusterSet` with its lags and sums in C, until failures are planned: then in Python. Raises ImportError."""

    def __init__(self, vehicle: Vehicle, dt: float, seed: int = 0) -> None:
        from sim.native._native import ThrusterBank

        super().__init__(vehicle, dt, seed)
        numbers = self.numbers()
        self.bank = ThrusterBank(pack(f"{len(numbers)}d", *numbers))

    @property
    def is_native(self) -> bool:
        """False as soon as a failure is planned, even if it begins later."""
        return self._failures is None

    @property
    def thrusts(self) -> list[float]:
        """The present thrust of each in N."""
        return self.bank.scaled_thrusts if self.is_native else self._thrusts

    @property
    def _static_thrusts(self) -> list[float]:
        return self.bank.thrusts if self.is_native else self._lagged

    def scale_thrusts(self, shares: Sequence[float] | None) -> None:
        """Set the shares of thrust near the surface: see ThrusterSet."""
        super().scale_thrusts(shares)
        self.bank.scale_thrusts([1.0] * len(self._thrusters) if shares is None else shares)

    def fail(self, failures: "Iterable[Failure]") -> None:
        """Plan failures: see ThrusterSet."""
        if self.is_native:  # the Python continues from the state of the C
            self._steps, self._shares = self.bank.steps, self.bank.shares
            self._lagged, self._thrusts = self.bank.thrusts, self.bank.scaled_thrusts
        super().fail(failures)

    def command(self, pwm_us: tuple[int, ...]) -> None:
        """Set the commanded pulse widths (us): see ThrusterSet."""
        super().command(pwm_us)
        self.bank.set_targets(self._targets)

    def _advance(self, nu_r: Sequence[float]) -> tuple[float, float, float, float, float, float]:
        return self.bank.step(nu_r) if self.is_native else super()._advance(nu_r)


class NativeErrorBank(ErrorBank):
    """`ErrorBank` in C. It continues the random numbers from the state of `random`. Raises ImportError."""

    def __init__(self, models: Iterable[ErrorModel], period: float, random: Random) -> None:
        from sim.native._native import Errors

        super().__init__(models, period, random)
        numbers = [x for process in self._processes for x in process.numbers()]
        _, key, second = random.getstate()
        self.errors = Errors(pack(f"{len(numbers)}d", *numbers), pack("625I", *key), second)

    def measure(self, true: Sequence[float]) -> list[float]:
        """Return the measured values for the `true` values: see ErrorBank."""
        return self.errors.measure(true)


def load(name: str) -> ModuleType:
    """Return a module in C.

    Raises ImportError if it is not installed, StaleExtensionError if its sources have changed since.
    """
    module = import_module(name)
    if not (module.__doc__ or "").endswith(_source_bytes(name.rpartition(".")[0])):
        raise StaleExtensionError(
            f"{module.__file__} was compiled from other sources than this version's; {COMPILE_AGAIN}"
        )
    return module


@lru_cache
def _source_bytes(package: str) -> str:
    """Return the expected end of the docstring of a package's C modules: the size of their sources.

    `c_extensions.source_bytes` writes it when they are compiled. The size is used because a hash would take longer.
    """
    files = os.scandir(os.path.join(ROOT, *package.split(".")))
    return f" {sum([file.stat().st_size for file in files if file.name.endswith(('.c', '.h'))])}"


def choose() -> tuple[type[Dynamics], str]:
    """Return the class of the dynamics, in C or Python as the environment selects, and the reason as text.

    Raises ConfigError if the environment demands C and it is missing, or if it was compiled from other sources.
    """
    selected = os.environ.get(SWITCH, "")
    if selected not in ("", "0", "1"):
        raise ConfigError(f"{SWITCH}={selected!r}: write 0 for the step in Python, 1 for the one in C, or leave it out")
    if selected == "0":
        return Dynamics, f"Python, as {SWITCH}=0 says"
    try:
        binary = load("sim.native._native")
    except ImportError as error:
        reason = f"the step in C is not there: {error}"
        if selected == "1":
            raise ConfigError(f"{SWITCH}=1, but {reason} ({REMEDY})") from None
        return Dynamics, f"Python; {reason}"
    return NativeDynamics, f"C, {binary.__file__}"


def has_native(binary: str = "") -> bool:
    """Return True if the C extension, and its module `binary` if given, is available and not switched off.

    Raises ConfigError as `choose` does.
    """
    if choose()[0] is not NativeDynamics:
        return False
    if binary:
        try:
            load(binary)
        except ImportError as error:  # the extensions were compiled before this module existed
            if os.environ.get(SWITCH) == "1":
                raise ConfigError(f"{SWITCH}=1, but {binary} is not there: {error} ({REMEDY})") from None
            return False
    return True
