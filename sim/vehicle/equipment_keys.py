"""The keys of a vehicle's file for its equipment. This module is loaded only for a vehicle that has some."""

from typing import NamedTuple

from sim.matrices import Entry
from sim.vehicle.ballast import BuoyancyEngine, DropWeight
from sim.vehicle.body_lift import CrossFlow, FadingDamping, Lift
from sim.vehicle.fins import Fin


class EquipmentKeys(NamedTuple):
    """The keys of a vehicle's file for its equipment; sim/vehicle/equipment.py describes them."""

    fins: tuple[Fin, ...] = ()
    lift: Lift | None = None
    cross_flow: CrossFlow | None = None
    buoyancy_engine: BuoyancyEngine | None = None
    drop_weights: tuple[DropWeight, ...] = ()
    forward_speed_damping: tuple[Entry, ...] = ()
    fading_damping: FadingDamping | None = None
