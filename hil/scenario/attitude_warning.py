"""Warn if a scenario's speed exceeds the limit up to which the vehicle's model holds its attitude."""

from hil.scenario.config import Scenario
from sim.vehicle.vehicle import Vehicle, load_vehicle


def requested_speed(scenario: Scenario) -> tuple[str, float]:
    """Return the key of the scenario that sets the speed of its vehicles, and that speed in m/s."""
    if scenario.hunting is not None:
        return "hunting: fields: max_speed", scenario.hunting.fields.max_speed
    return "master: speed", scenario.master.speed


def attitude_warning(scenario: Scenario, vehicle: Vehicle | None = None) -> str | None:
    """Return a warning if the scenario's speed exceeds the limit at which its vehicle's model holds its attitude.

    Otherwise return None. `vehicle` is the scenario's; it is loaded if left out. Raises ConfigError.
    """
    vehicle = vehicle or load_vehicle(scenario.vehicle)[0]
    key, speed = requested_speed(scenario)
    limit = vehicle.attitude_limit_speed
    if limit is None or speed <= limit:
        return None
    return (
        f"{scenario.path}: {key}: {speed:g} m/s, but the model {vehicle.name} loses its attitude above "
        f"{limit:g} m/s (attitude_limit_speed of its file): ask for less, or take another vehicle"
    )
