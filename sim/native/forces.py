"""The C twins of equipment and of waves at a hull (sim/native/forces.h). Loaded only where there is one."""

from collections.abc import Sequence
from struct import pack
from typing import Any, TypeVar

from sim.forces import Force

Twin = TypeVar("Twin")

# In the order of the kinds in forces.h. A class derived from one of these stays in Python.
KINDS = (
    "sim.vehicle.body_lift:HullLift",
    "sim.vehicle.body_lift:CrossFlowDrag",
    "sim.vehicle.body_lift:SpeedDamping",
    "sim.vehicle.body_lift:SlowDamping",
    "sim.vehicle.fins:FinSet",
    "sim.vehicle.ballast:Bladder",
    "sim.environment.stratification:WavySurface",
)
MOST = 8


def make_twins(forces: Sequence[Force], kind: type[Twin]) -> tuple[Twin, ...] | None:
    """Return the twins of all `forces`, which move their servos in C from now on; None if one of them has none.

    `kind` is the Force of sim.native._native.
    """
    if len(forces) > MOST or not all(_kind(force) in KINDS and _has_native_waves(force) for force in forces):
        return None
    return tuple([_make_twin(force, kind) for force in forces])


def _kind(force: Force) -> str:
    return f"{type(force).__module__}:{type(force).__qualname__}"


def _has_native_waves(force: Force) -> bool:
    wave_field = vars(force).get("wave_field")
    return wave_field is None or hasattr(wave_field, "twin")


def _make_twin(force: Any, kind: type[Twin]) -> Twin:
    """Return the twin of one force that is in C; one with servos keeps its first, which stores where they are."""
    parts = vars(force)
    servos, wave_field = parts.get("servos"), parts.get("wave_field")
    if isinstance(servos, kind):
        return servos
    numbers = force.numbers()
    moved = servos.numbers() if servos is not None else []
    packed = pack(f"{len(numbers)}d", *numbers), pack(f"{len(moved)}d", *moved)
    make: Any = kind
    twin: Twin = make(KINDS.index(_kind(force)), *packed, wave_field and wave_field.twin)
    if servos is not None:
        parts["servos"] = twin
    if wave_field is not None:
        parts["twin"] = twin
    return twin
