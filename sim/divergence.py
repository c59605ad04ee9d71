"""Find which term made the state of a vehicle infinite or not a number, for the error message of a failed step."""

from collections.abc import Iterable, Sequence
from math import isfinite

from sim import rotations
from sim.dynamics import Dynamics, State, velocity_through_water
from sim.matrices import times

# Terms of `sim.dynamics.Forces` that depend on the vehicle's file.
VEHICLE_TERMS = ("quadratic_damping", "linear_damping", "restoring", "coriolis")
# Of the flights that tell whether the step is the cause: speeds (m/s, rad/s) at their start, steps, the speed that no
# vehicle has, the depth (m), and how often the step is halved.
_SPEEDS, _STEPS, _ABSURD, _DEEP, _HALVINGS = [2.0**number for number in range(10)], 200, 1e3, 100.0, 9


def find_cause(dynamics: Dynamics, state: State, wrench: Sequence[float], current: Sequence[float], dt: float) -> str:
    """Return what is not finite in the step of `dt` s from `state`, and what to do about it.

    `state` is the last finite state, `wrench` (N, N m, body axes) that of thrusters and waves, `current` the velocity
    of the water (NED, m/s).
    """
    candidates = {
        "its velocity": (state.nu, "set finite numbers"),
        "its position": (state.position, "set finite numbers"),
        "its attitude": (state.quaternion, "set finite numbers"),
        "its acceleration": (state.nu_dot, "set finite numbers"),
        "the current": (current, "look at the world's currents and waves"),
        "the wrench of thrusters and waves": (wrench, "look at the thrusters' curves and lags"),
    }
    is_absurd = isfinite(_largest(state.nu)) and _largest(state.nu) > _ABSURD  # the rest is then a consequence
    for name, (numbers, remedy) in candidates.items():
        bad = _first_not_finite(numbers)
        if bad is not None and not is_absurd:
            return f"{name} is {bad:g}: {remedy}"
    if not any(x * x for x in state.quaternion) and not is_absurd:
        return "its attitude is a quaternion of length 0: set one of length 1, (1, 0, 0, 0) for level and north"
    stable = _stable_step(dynamics, state, current, dt)
    most = _largest(state.nu)
    level = State((0.0, 0.0, _DEEP), nu=[x / most for x in state.nu] if is_absurd else state.nu)
    rotation = rotations.matrix(level.quaternion)
    nu_r = velocity_through_water(rotation, level.nu, current)
    terms = dynamics.forces(level, wrench, current)._asdict()
    forces: dict[str, Sequence[float]] = {f"the term {key}": terms[key] for key in VEHICLE_TERMS}
    for force in dynamics.others:
        name = f"the force {type(force).__module__}:{type(force).__qualname__}"
        forces[name] = force.wrench(level.position, rotation, nu_r)
        bad = _first_not_finite(forces[name])
        if bad is not None:
            return f"{name} is {bad:g}: correct that class"
    name = max(forces, key=lambda key: _largest(times(dynamics.inverse_mass, *forces[key])))
    if stable:
        return (
            f"{name} is too strong for a step of {1e3 * dt:g} ms, which makes any motion grow; take a step of "
            f"{1e3 * stable:.3g} ms, or look at {name} of this vehicle"
        )
    return f"{name} makes any motion grow, at a shorter step too: look at its sign and its numbers"


def _stable_step(dynamics: Dynamics, state: State, current: Sequence[float], dt: float) -> float | None:
    """Return the longest of `dt` / 2, `dt` / 4, ... s with which a flight stays finite that diverges with `dt`.

    It begins level, in the direction of `state.nu`, at the speeds of a vehicle: 1 m/s and rad/s or faster. None if a
    shorter step does not help.
    """
    most = _largest(state.nu) or 1.0

    def diverges_after(speed: float, step: float, steps: int) -> int:
        """Return after how many steps it has diverged; 0 if it has not after `steps`."""
        for side in (speed, -speed):  # with the current and against it
            flown = State((0.0, 0.0, _DEEP), nu=[side * x / most for x in state.nu])
            for number in range(1, steps + 1):
                try:
                    dynamics.step(flown, (0.0,) * 6, current, step)
                except FloatingPointError:
                    return number
                if _largest(flown.nu) > _ABSURD:
                    return number
        return 0

    for speed in _SPEEDS:
        count = diverges_after(speed, dt, _STEPS)
        if count:
            halvings = range(1, _HALVINGS + 1)
            return next((dt / 2**n for n in halvings if not diverges_after(speed, dt / 2**n, 4 * count * 2**n)), None)
    return None


def _first_not_finite(numbers: Iterable[float]) -> float | None:
    """Return the first value that is not finite, or None."""
    return next((x for x in numbers if not isfinite(x)), None)


def _largest(numbers: Iterable[float]) -> float:
    """Return the largest magnitude; infinity if one is not a number."""
    return max(abs(x) if x == x else float("inf") for x in numbers)
