"""Make the C twins of the forces of equipment, waves and wind (sim/native/forces.h). Loaded when needed."""

from collections.abc import Sequence
from struct import pack
from typing import Any, TypeVar

from sim.forces import Force

Twin = TypeVar("Twin")

# In the order of the kinds in forces.h. A class derived from one of these has no twin.
KINDS = (
    "sim.vehicle.body_lift:HullLift",
    "sim.vehicle.body_lift:CrossFlowDrag",
    "sim.vehicle.body_lift:SpeedDamping",
    "sim.vehicle.body_lift:SlowDamping",
    "sim.vehicle.fins:FinSet",
    "sim.vehicle.ballast:Bladder",
    "sim.environment.stratification:WavySurface",
    "sim.environment.wind:WindForce",
    "sim.vehicle.thrusters.azimuth:AzimuthSet",
)
MAX_FORCES = 8


def make_twins(forces: Sequence[Force], kind: type[Twin]) -> tuple[Twin, ...] | None:
    """Return the C twins of all `forces`, or None if one of them has no twin. From then on servos move in C.

    `kind` is the class Force of sim.native._native.
    """
    if len(forces) > MAX_FORCES or not all(_kind(force) in KINDS and _has_native_waves(force) for force in forces):
        return None
    return tuple([_make_twin(force, kind) for force in forces])


def _kind(force: Force) -> str:
    return f"{type(force).__module__}:{type(force).__qualname__}"


def _has_native_waves(force: Force) -> bool:
    wave_field = vars(force).get("wave_field")
    return wave_field is None or hasattr(wave_field, "twin")


def _make_twin(force: Any, kind: type[Twin]) -> Twin:
    """Return the twin of one force. One with servos keeps its first twin, which holds the servos' positions."""
    attributes = vars(force)
    servos, wave_field = attributes.get("servos"), attributes.get("wave_field")
    if isinstance(servos, kind):
        return servos
    numbers = force.numbers()
    servo_numbers = servos.numbers() if servos is not None else []
    packed = pack(f"{len(numbers)}d", *numbers), pack(f"{len(servo_numbers)}d", *servo_numbers)
    make: Any = kind
    twin: Twin = make(KINDS.index(_kind(force)), *packed, wave_field and wave_field.twin)
    if servos is not None:
        attributes["servos"] = twin
    if hasattr(force, "twin"):
        attributes["twin"] = twin
    return twin
