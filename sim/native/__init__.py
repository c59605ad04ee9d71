"""C versions of what every step computes, equal to Python to the last bit. sim/assembly.py selects.

Public: `choose`, `load`, `NativeDynamics`. It must not compute anything that Python does not specify.

`UUV_HIL_NATIVE=0` in the environment takes the Python, `UUV_HIL_NATIVE=1` insists on the C.
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
from sim.dynamics import Dynamics, Integrator, State
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
    """`Dynamics` with its step in C. Raises ImportError where there is none.

    So are the forces of sim/native/forces.py. Where there is another one, all forces stay in Python: Verlet asks them
    once a step, before the C; Runge-Kutta needs them between its stages and then is that of Python.
    """

    is_whole = False  # True if the forces are in C, too

    def __init__(
        self,
        vehicle: Vehicle,
        density: float,
        gravity: float,
        integrator: Integrator = "verlet",
        forces: "Sequence[Force]" = (),
    ) -> None:
        from sim.native._native import Kernel

        super().__init__(vehicle, density, gravity, integrator, forces)
        twins = _twins(forces)
        if twins is None and integrator == "rk4":
            return
        numbers = self.numbers()
        self.is_whole = twins is not None
        self.kernel = Kernel(pack(f"{len(numbers)}d", *numbers), twins or ())
        self._advance = self.kernel.step if self.is_whole else self._pushed_step

    def _pushed_step(self, state: State, wrench: Sequence[float], current: Sequence[float], dt: float) -> None:
        position, rotation, nu = self.kernel.midway(state, dt)
        self.kernel.step(state, self.push(position, rotation, nu, wrench, current), current, dt)


def _twins(forces: "Sequence[Force]") -> "tuple[Twin, ...] | None":
    """Return the forces in C; None if one of them is not."""
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
    def works(self) -> bool:
        """False once failures are planned, also future ones."""
        return self._failures is None

    @property
    def thrusts(self) -> list[float]:
        """The present thrust of each in N."""
        return self.bank.pushes if self.works else self._thrusts

    def immerse(self, shares: Sequence[float] | None) -> None:
        """Set the shares of thrust near the surface: see ThrusterSet."""
        super().immerse(shares)
        self.bank.immerse([1.0] * len(self._thrusters) if shares is None else shares)

    def fail(self, failures: "Iterable[Failure]") -> None:
        """Plan failures: see ThrusterSet."""
        if self.works:  # until now
            self._steps, self._shares = self.bank.steps, self.bank.shares
            self._lagged, self._thrusts = self.bank.thrusts, self.bank.pushes
        super().fail(failures)

    def command(self, pwm_us: tuple[int, ...]) -> None:
        """Set the commanded pulse widths (us): see ThrusterSet."""
        super().command(pwm_us)
        self.bank.aim(self._targets)

    def _advance(self, nu_r: Sequence[float]) -> tuple[float, float, float, float, float, float]:
        return self.bank.step(nu_r) if self.works else super()._advance(nu_r)


class NativeErrorBank(ErrorBank):
    """`ErrorBank` in C, with random numbers of its own that go on where `random` stood. Raises ImportError."""

    def __init__(self, models: Iterable[ErrorModel], period: float, random: Random) -> None:
        from sim.native._native import Errors

        super().__init__(models, period, random)
        numbers = [x for process in self._processes for x in process.numbers()]
        _, key, second = random.getstate()
        self.errors = Errors(pack(f"{len(numbers)}d", *numbers), pack("625I", *key), second)

    def measure(self, true: Sequence[float]) -> list[float]:
        """Return the measured values of the true ones: see ErrorBank."""
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
    """Return how the text of a package's modules ends, see `c_extensions.source_bytes`; a hash would take longer."""
    files = os.scandir(os.path.join(ROOT, *package.split(".")))
    return f" {sum([file.stat().st_size for file in files if file.name.endswith(('.c', '.h'))])}"


def choose() -> tuple[type[Dynamics], str]:
    """Return the class with the step that the environment asks for, and why it is this one, in words.

    Raises ConfigError if what it asks for cannot be had, or was compiled from other sources.
    """
    wish = os.environ.get(SWITCH, "")
    if wish not in ("", "0", "1"):
        raise ConfigError(f"{SWITCH}={wish!r}: write 0 for the step in Python, 1 for the one in C, or leave it out")
    if wish == "0":
        return Dynamics, f"Python, as {SWITCH}=0 says"
    try:
        binary = load("sim.native._native")
    except ImportError as error:
        reason = f"the step in C is not there: {error}"
        if wish == "1":
            raise ConfigError(f"{SWITCH}=1, but {reason} ({REMEDY})") from None
        return Dynamics, f"Python; {reason}"
    return NativeDynamics, f"C, {binary.__file__}"


def has_native(binary: str = "") -> bool:
    """Return whether the C is there, the module `binary` of it too, and not unwanted.

    Raises ConfigError as `choose` does.
    """
    if choose()[0] is not NativeDynamics:
        return False
    if binary:
        try:
            load(binary)
        except ImportError as error:  # made before there was one
            if os.environ.get(SWITCH) == "1":
                raise ConfigError(f"{SWITCH}=1, but {binary} is not there: {error} ({REMEDY})") from None
            return False
    return True
