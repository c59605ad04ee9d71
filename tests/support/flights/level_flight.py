"""Attitude of a vehicle under its own controller, at each commanded speed."""

from math import acos, asin, atan2, degrees, inf
from typing import NamedTuple

from hil.cases.simulated import SimulatedVehicle, fly
from hil.commands.vehicle.command import top
from hil.common.schema import preset_names
from hil.master.flight import prepare
from hil.scenario.config import load_scenario
from sim.vehicle.vehicle import load_vehicle

# What a vehicle is asked that can stop and turn, and what one that has to keep moving.
FIELD, OPEN = "paper_field", "open_water"
NAMES = [name for name in preset_names("sim/vehicles") if not load_vehicle(name)[0].hull]  # those with a hull float
LIMITS = {name: load_vehicle(name)[0].attitude_limit_speed for name in NAMES}
# Those that steer by fins pitch in order to dive, and need room.
SWIMMERS = [name for name in NAMES if load_vehicle(name)[0].fins]
LEVEL = [name for name in NAMES if LIMITS[name] is None and name not in SWIMMERS]
MAX_TILT = 10.0  # deg
MAX_OFF_DEPTH = 0.2  # m


class LevelFlight(NamedTuple):
    """The greatest deviations from level (deg) and from the commanded depth (m).

    `tilt` is the angle between the vehicle's down and the world's, `speed` the highest surge in m/s.
    """

    pitch: float
    roll: float
    tilt: float
    depth_error: float
    speed: float


def top_speed(name: str) -> float:
    """Return the surge (m/s) at which drag equals the maximum thrust of a preset."""
    return top(load_vehicle(name)[0])[0].speed[0]


def fly_level(name: str, speed: float, scenario: str = FIELD, seconds: float = inf) -> LevelFlight:
    """Fly a preset through a scenario at a commanded `speed` (m/s), for at most so long."""
    loaded = load_scenario(scenario)
    depth = loaded.start.depth
    limit = min(seconds, 60.0 + 75.0 / speed)
    requested = loaded._replace(vehicle=name, master=loaded.master._replace(speed=speed, depth=depth, time_limit=limit))
    plan = prepare(requested)
    vehicle = SimulatedVehicle(requested, plan.world)
    largest = LevelFlight(0.0, 0.0, 0.0, 0.0, 0.0)

    def watch(vehicle: SimulatedVehicle) -> None:
        nonlocal largest
        if vehicle.time_ns % 20_000_000:
            return
        truth = vehicle.simulation.truth()
        w, x, y, z = truth.orientation
        upright = min(1.0, max(-1.0, 1.0 - 2.0 * (x * x + y * y)))
        pitch = asin(min(1.0, max(-1.0, 2.0 * (w * y - z * x))))
        roll = atan2(2.0 * (w * x + y * z), upright)
        off = abs(truth.position[2] - depth)
        now = degrees(abs(pitch)), degrees(abs(roll)), degrees(acos(upright)), off, truth.nu[0]
        largest = LevelFlight(*map(max, now, largest))

    fly(requested, plan, vehicle, [watch])
    return largest


def check_level(name: str, share: float, scenario: str = FIELD, seconds: float = inf) -> None:
    """Fly a preset at this share of its top speed, and check attitude, depth, and reached speed."""
    flight = fly_level(name, share * top_speed(name), scenario, seconds)
    assert flight.tilt < MAX_TILT
    assert flight.depth_error < MAX_OFF_DEPTH
    assert flight.speed > 0.8 * min(share, 1.0) * top_speed(name)  # which the controller's limits may keep it from
