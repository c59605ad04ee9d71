"""Name the term that made a vehicle's state not a number, for the error message after the step failed."""

from collections.abc import Iterable, Sequence
from math import isfinite

from sim import rotations
from sim.dynamics import Dynamics, State, through_water

# Terms of `sim.dynamics.Forces` that the vehicle's own numbers make; of those that are infinite the first is named.
OWN = ("quadratic_damping", "linear_damping", "restoring", "coriolis")


def find_cause(dynamics: Dynamics, state: State, wrench: Sequence[float], current: Sequence[float], dt: float) -> str:
    """Return what is not finite in the step of `dt` s from `state`, the last finite one, and what to do about it.

    `wrench` (N, N m, body axes) is that of thrusters and waves, `current` the velocity of the water, NED in m/s.
    """
    given = {
        "its position": (state.position, "set finite numbers"),
        "its attitude": (state.quaternion, "set finite numbers"),
        "its velocity": (state.nu, "set finite numbers"),
        "its acceleration": (state.nu_dot, "set finite numbers"),
        "the current": (current, "look at the world's currents and waves"),
        "the wrench of thrusters and waves": (wrench, "look at the thrusters' curves and lags"),
    }
    for name, (numbers, remedy) in given.items():
        odd = _odd(numbers)
        if odd is not None:
            return f"{name} is {odd:g}: {remedy}"
    rotation = rotations.matrix(state.quaternion)
    nu_r = through_water(rotation, state.nu, current)
    for force in dynamics.others:
        odd = _odd(force.wrench(state.position, rotation, nu_r))
        if odd is not None:
            return f"the force {type(force).__module__}:{type(force).__qualname__} is {odd:g}: mend that class"
    terms = dynamics.forces(state, wrench, current)._asdict()
    name = max(OWN, key=lambda key: _size(terms[key]))
    return (
        f"the term {name} has grown to {_size(terms[name]):.3g} N (N m): a step of {1e3 * dt:g} ms is too long for "
        "this vehicle's numbers; take a shorter step, or look at that term in the vehicle's file"
    )


def _odd(numbers: Iterable[float]) -> float | None:
    """Return the first value that is not finite."""
    return next((x for x in numbers if not isfinite(x)), None)


def _size(numbers: Iterable[float]) -> float:
    """Return the largest; infinite if one is not a number."""
    return max(abs(x) if x == x else float("inf") for x in numbers)
