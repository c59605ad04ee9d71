"""Find which term made the state of a vehicle infinite or not a number, for the error message of a failed step."""

from collections.abc import Iterable, Sequence
from math import isfinite

from sim import rotations
from sim.dynamics import Dynamics, State, velocity_through_water

# Terms of `sim.dynamics.Forces` that depend on the vehicle's file. The first one that is infinite is reported.
VEHICLE_TERMS = ("quadratic_damping", "linear_damping", "restoring", "coriolis")


def find_cause(dynamics: Dynamics, state: State, wrench: Sequence[float], current: Sequence[float], dt: float) -> str:
    """Return what is not finite in the step of `dt` s from `state`, and what to do about it.

    `state` is the last finite state, `wrench` (N, N m, body axes) that of thrusters and waves, `current` the velocity
    of the water (NED, m/s).
    """
    candidates = {
        "its position": (state.position, "set finite numbers"),
        "its attitude": (state.quaternion, "set finite numbers"),
        "its velocity": (state.nu, "set finite numbers"),
        "its acceleration": (state.nu_dot, "set finite numbers"),
        "the current": (current, "look at the world's currents and waves"),
        "the wrench of thrusters and waves": (wrench, "look at the thrusters' curves and lags"),
    }
    for name, (numbers, remedy) in candidates.items():
        bad = _first_not_finite(numbers)
        if bad is not None:
            return f"{name} is {bad:g}: {remedy}"
    rotation = rotations.matrix(state.quaternion)
    nu_r = velocity_through_water(rotation, state.nu, current)
    for force in dynamics.others:
        bad = _first_not_finite(force.wrench(state.position, rotation, nu_r))
        if bad is not None:
            return f"the force {type(force).__module__}:{type(force).__qualname__} is {bad:g}: correct that class"
    terms = dynamics.forces(state, wrench, current)._asdict()
    name = max(VEHICLE_TERMS, key=lambda key: _largest(terms[key]))
    return (
        f"the term {name} has grown to {_largest(terms[name]):.3g} N (N m): a step of {1e3 * dt:g} ms is too long for "
        "this vehicle's numbers; take a shorter step, or look at that term in the vehicle's file"
    )


def _first_not_finite(numbers: Iterable[float]) -> float | None:
    """Return the first value that is not finite, or None."""
    return next((x for x in numbers if not isfinite(x)), None)


def _largest(numbers: Iterable[float]) -> float:
    """Return the largest magnitude; infinity if one is not a number."""
    return max(abs(x) if x == x else float("inf") for x in numbers)
