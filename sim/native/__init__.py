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
    from sim.failures import Failure
    from sim.forces import Force
    from sim.native._native import Coast
    from sim.rays.geometry import Geometry
    from sim.sensors.samples import ImuSample

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
        self.kernel = Kernel(pack(f"{len(numbers)}d", *numbers))
        self._advance = self._pushed_step if forces else self.kernel.step

    def _pushed_step(self, state: State, wrench: Sequence[float], current: Sequence[float], dt: float) -> None:
        pushed = self.push(state.position, matrix(state.quaternion), state.nu, wrench, current)
        self.kernel.step(state, pushed, current, dt)


class NativeThrusterSet(ThrusterSet):
    """`ThrusterSet` with its lags and sums in C, until failures are planned: then in Python. Raises ImportError."""

    def __init__(self, vehicle: Vehicle, dt: float, seed: int = 0) -> None:
        from sim.native._native import Mixer

        super().__init__(vehicle, dt, seed)
        numbers = self.numbers()
        self.mixer = Mixer(pack(f"{len(numbers)}d", *numbers))

    @property
    def works(self) -> bool:
        """False once there are failures, be they still to come."""
        return self._failures is None

    @property
    def thrusts(self) -> list[float]:
        """As the one it stands for."""
        return self.mixer.thrusts if self.works else self._thrusts

    def fail(self, failures: "Iterable[Failure]") -> None:
        """As the one it stands for."""
        if self.works:  # until now
            self._steps = self.mixer.steps
            self._lagged = self._thrusts = self.mixer.thrusts
        super().fail(failures)

    def command(self, pwm_us: tuple[int, ...]) -> None:
        """Let the steps from now on go towards what these pulses (us, one a thruster) give. Raises ConfigError."""
        self._command(pwm_us)

    def _command(self, pwm_us: tuple[int, ...]) -> None:
        super()._command(pwm_us)
        self.mixer.aim(self._targets)

    def _advance(self, nu_r: Sequence[float]) -> tuple[float, float, float, float, float, float]:
        return self.mixer.step() if self.works else super()._advance(nu_r)


class NativeErrorBank(ErrorBank):
    """`ErrorBank` in C, with random numbers of its own that go on where `random` stood. Raises ImportError."""

    def __init__(self, models: Iterable[ErrorModel], period: float, random: Random) -> None:
        from sim.native._native import Errors

        super().__init__(models, period, random)
        numbers = [x for process in self._processes for x in process.numbers()]
        _, key, second = random.getstate()
        self.errors = Errors(pack(f"{len(numbers)}d", *numbers), pack("625I", *key), second)

    def measure(self, true: Sequence[float]) -> list[float]:
        """As the one it stands for."""
        return self.errors.measure(true)


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

        if not hasattr(binary, "Coast"):
            raise ImportError(f"{binary.__file__} was made before the newest source")
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


def make_state(position: Sequence[float], quaternion: Sequence[float]) -> State:
    """The state of a vehicle at rest (NED in m; w x y z, body to world), the quickest there is; else as `choose`.

    That of C gives tuples, which are copies.
    """
    if not has_native():
        return State(position, quaternion)
    from sim.native._native import State as NativeState

    return NativeState(position, quaternion)


def make_coast(
    state: State,
    dynamics: Dynamics,
    thrusters: ThrusterSet,
    current: Sequence[float],
    dt: float,
    half_height: float,
) -> "Coast | None":
    """A step of `dt` s of all of these at once in C; None if one of them is not in C, or a thruster may fail.

    `dynamics` has no other forces, `current` is the velocity of the water NED in m/s, and the vehicle reaches
    `half_height` m below its origin. Of no use any more once failures are planned.
    """
    if not (isinstance(dynamics, NativeDynamics) and isinstance(thrusters, NativeThrusterSet) and thrusters.works):
        return None
    from sim.native._native import Coast

    return Coast(state, dynamics.kernel, thrusters.mixer, thrusters.command, current, dt, half_height)


def make_imu(
    errors: ErrorBank, sample: "type[ImuSample]", position: Sequence[float], gravity: float
) -> "Callable[[int, State], ImuSample] | None":
    """What samples in C as sim.sensors.imu.Imu does, along the vehicle's axes; None if `errors` are not in C.

    The unit is at `position` (m, body axes), under `gravity` m/s².
    """
    if not isinstance(errors, NativeErrorBank):
        return None
    from sim.native._native import Imu

    return Imu(errors.errors, sample, position, gravity).sample


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
