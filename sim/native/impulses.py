"""Solve the impulses of a collision in C (sim/native/impulses.h). Importing it raises ImportError without the C."""

from collections.abc import Sequence

from sim.environment.contact.impulses import Touch
from sim.matrices import Matrix
from sim.native import _native


def apply_impulses(
    touches: Sequence[Touch], inverse_mass: Matrix, nu: Sequence[float], friction: float, restitution: float
) -> tuple[list[float], list[float]]:
    """Return nu and impulse after a collision: see sim.environment.contact.impulses."""
    return _native.apply_impulses(
        _numbers(touches), [x for row in inverse_mass for x in row], nu, friction, restitution
    )


def separate(touches: Sequence[Touch], inverse_mass: Matrix) -> list[float]:
    """Return the least displacement that removes the penetration: see sim.environment.contact.impulses."""
    return _native.separate(_numbers(touches), [x for row in inverse_mass for x in row])


def _numbers(touches: Sequence[Touch]) -> list[float]:
    return [x for depth, normal, lever, _ in touches for x in (depth, *normal, *lever)]
