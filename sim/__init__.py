"""The simulator: vehicle, environment, sensors, and the step that advances them.

Public: the names below, each imported on first use, and `sim.assembly`; also `dynamics`, `forces`, `geodesy`,
`interpolation`, `matrices`, `rotations`, `run_events`, `simulation`, `tether`. It must not do input or output, start
threads or read a clock: time comes in as an argument.
"""

from hil.common.public import public_name

TYPE_CHECKING = False  # as typing has it, which a lean process does not load for this
if TYPE_CHECKING:
    from typing import Any

    from sim.dynamics import State as State
    from sim.environment.world import World as World
    from sim.environment.world import load_world as load_world
    from sim.forces import Force as Force
    from sim.sensors.own import OwnSensor as OwnSensor
    from sim.sensors.sensor_set import load_device as load_device
    from sim.simulation import Simulation as Simulation
    from sim.vehicle.vehicle import Vehicle as Vehicle
    from sim.vehicle.vehicle import load_vehicle as load_vehicle

# module -> its public names
PUBLIC = {
    "sim.dynamics": ("State",),
    "sim.environment.world": ("World", "load_world"),
    "sim.forces": ("Force",),
    "sim.sensors.own": ("OwnSensor",),
    "sim.sensors.sensor_set": ("load_device",),
    "sim.simulation": ("Simulation",),
    "sim.vehicle.vehicle": ("Vehicle", "load_vehicle"),
}


def __getattr__(name: str) -> "Any":
    return public_name(__name__, PUBLIC, name)


def __dir__() -> list[str]:
    return sorted([*globals(), *[name for names in PUBLIC.values() for name in names]])
