"""What every step needs, in C where it was compiled, else in Python: the same numbers to the last bit.

`UUV_HIL_NATIVE=0` in the environment takes the Python, `UUV_HIL_NATIVE=1` insists on the C.
"""

import os
from collections.abc import Callable, Iterable, Sequence
from random import Random
from struct import pack
from typing import TYPE_CHECKING

from hil.errors import ConfigError
from sim.dynamics import Dynamics, Integrator, State
from sim.rotations import matrix
from sim.sensors.error import ErrorBank, ErrorModel
from sim.thrusters import ThrusterSet
from sim.vehicle import Vehicle

if TYPE_CHECKING:
    from sim.forces import Force
    from sim.rays.geometry import Geometry

SWITCH = "UUV_HIL_NATIVE"


class NativeDynamics(Dynamics):
    """`Dynamics` with its step in C. Raises ImportError where there is none.

    Other forces stay in Python: semi-implicit Euler asks them once a step, before the C; Runge-Kutta needs
    them between its stages and then is that of Python.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        density: float,
        gravity: float,
        integrator: Integrator = "semi_implicit_euler",
        forces: "Sequence[Force]" = (),
    ) -> None:
        from sim.native._native import Kernel

        super().__init__(vehicle, density, gravity, integrator, forces)
        if forces and integrator == "rk4":
            return
        numbers = self.numbers()
        self._kernel_step = Kernel(pack(f"{len(numbers)}d", *numbers)).step
        self._advance = self._pushed_step if forces else self._kernel_step

    def _pushed_step(self, state: State, wrench: Sequence[float], current: Sequence[float], dt: float) -> None:
        pushed = self.push(state.position, matrix(state.quaternion), state.nu, wrench, current)
        self._kernel_step(state, pushed, current, dt)


class NativeThrusterSet(ThrusterSet):
    """`ThrusterSet` with its lags and sums in C; while thrusters fail, in Python. Raises ImportError."""

    def __init__(self, vehicle: Vehicle, dt: float, seed: int = 0) -> None:
        from sim.native._native import Mixer

        super().__init__(vehicle, dt, seed)
        numbers = self.numbers()
        self._mix = Mixer(pack(f"{len(numbers)}d", *numbers)).step

    def _advance(self, nu_r: Sequence[float]) -> tuple[float, float, float, float, float, float]:
        if self._failures is not None:
            return super()._advance(nu_r)
        self._lagged, wrench = self._mix(self._lagged, self._targets)
        self.thrusts = self._lagged
        return wrench


class NativeErrorBank(ErrorBank):
    """`ErrorBank` in C, with random numbers of its own that go on where `random` stood. Raises ImportError."""

    def __init__(self, models: Iterable[ErrorModel], period: float, random: Random) -> None:
        from sim.native._native import Errors

        super().__init__(models, period, random)
        numbers = [x for process in self._processes for x in process.numbers()]
        _, key, second = random.getstate()
        self._measure = Errors(pack(f"{len(numbers)}d", *numbers), pack("625I", *key), second).measure

    def measure(self, true: Sequence[float]) -> list[float]:
        """As the one it stands for."""
        return self._measure(true)


def choose() -> tuple[type[Dynamics], str]:
    """The class with the step that the environment asks for, and why it is this one, in words.

    Raises ConfigError if what it asks for cannot be had.
    """
    wish = os.environ.get(SWITCH, "")
    if wish not in ("", "0", "1"):
        raise ConfigError(f"{SWITCH}={wish!r}: write 0 for the step in Python, 1 for the one in C, or leave it out")
    if wish == "0":
        return Dynamics, f"Python, as {SWITCH}=0 says"
    try:
        import sim.native._native as binary
    except ImportError as error:
        reason = f"the step in C is not there: {error} (make it with: python -m sim.native.build)"
        if wish == "1":
            raise ConfigError(f"{SWITCH}=1, but {reason}") from None
        return Dynamics, f"Python; {reason}"
    return NativeDynamics, f"C, {binary.__file__}"


def make_dynamics(
    vehicle: Vehicle,
    density: float,
    gravity: float,
    integrator: Integrator = "semi_implicit_euler",
    forces: "Sequence[Force]" = (),
) -> Dynamics:
    """The equations of one vehicle in water of `density` kg/m³ under `gravity` m/s², with the quickest step there is.

    Raises ConfigError as `choose` does.
    """
    dynamics, _ = choose()
    return dynamics(vehicle, density, gravity, integrator, forces)


def make_thruster_set(vehicle: Vehicle, dt: float, seed: int = 0) -> ThrusterSet:
    """The thrusters of a vehicle that has only lagged quadratic ones, the quickest there are; else as `choose`."""
    return (NativeThrusterSet if has_native() else ThrusterSet)(vehicle, dt, seed)


def make_error_bank(models: Iterable[ErrorModel], period: float, random: Random) -> ErrorBank:
    """The errors of one sensor, sampled every `period` s, the quickest there are; else as `choose`."""
    return (NativeErrorBank if has_native() else ErrorBank)(models, period, random)


def make_caster(geometry: "Geometry") -> "Callable[..., None] | None":
    """What casts rays in C as sim.rays.single.cast does, without its first argument; None where there is no C.

    Raises ConfigError as `choose` does.
    """
    if not has_native():
        return None
    try:
        from sim.native._rays import Caster
    except ImportError:  # made before there were rays
        return None
    _, _, solids, nodes, triangles = geometry
    terrain, depth = geometry.terrain, geometry.depth
    if terrain is None:
        return Caster((0, 0, 0.0, 0.0, 1.0, depth), b"", solids, nodes, triangles).cast
    north_min, east_min, _, rows, columns = terrain.grid
    ground = rows, columns, north_min, east_min, terrain.scale, terrain.outside
    return Caster(ground, terrain.depths, solids, nodes, triangles).cast


def has_native() -> bool:
    """Whether the C is there and not unwanted. Raises ConfigError as `choose` does."""
    return choose()[0] is NativeDynamics
