"""Settings of the gateway from a scenario: origin, motors, and parameters that suit the vehicle."""

from hil.autopilots.frames import AUTO, CUSTOM, MotorMap, load_frame, map_motors
from hil.common.errors import ConfigError
from hil.common.tables import state_path
from hil.gateways.mavlink.snapshot import Origin
from hil.scenario.config import AUTOPILOTS, Scenario
from sim.environment.world import load_world
from sim.vehicle.thrusters.bank import wrench_matrix
from sim.vehicle.vehicle import load_vehicle

AUTOPILOT_SYSTEM = 1  # id of an autopilot that flies the vehicle: ArduSub's and PX4's default
MAX_MOTORS = 8  # of a frame of ArduSub
MAX_SHARE = 0.8  # of what the thrusters can do together, at full stick


def parameter_file(node: str) -> str:
    """Return where the parameters of a node are stored on this machine."""
    return state_path(f"mavlink-{node}.toml")


def origin_of(scenario: Scenario | None) -> Origin | None:
    """Return the origin of the scenario's world, None if it has none. Raises ConfigError."""
    if scenario is None:
        return None
    world = load_world(scenario.world)
    return Origin(*world.origin, world.origin_altitude) if world.origin else None


def defaults_of(scenario: Scenario | None) -> dict[str, float]:
    """Return parameters that differ from one vehicle to the next: system id, frame, forces. Raises ConfigError."""
    if scenario is None:
        return {}
    vehicle, _ = load_vehicle(scenario.vehicle)
    defaults = {"HIL_STEER": float(bool(vehicle.fins)), "BATT_MONITOR": 4.0 if vehicle.battery else 0.0}
    if vehicle.battery:
        defaults["BATT_CAPACITY"] = float(round(1000.0 * vehicle.battery.capacity_ah))
    motors = _motors(scenario)
    if motors.frame != CUSTOM:
        defaults["FRAME_CONFIG"] = float(load_frame(motors.frame).frame_config)
    system = scenario.mavlink.system if scenario.mavlink else 1
    is_taken = system == AUTOPILOT_SYSTEM and scenario.controller in AUTOPILOTS
    defaults["SYSID_THISMAV"] = float(system + is_taken)
    rows = wrench_matrix(vehicle, torque=False)
    thrusts = [min(thruster.max_forward, thruster.max_reverse) for thruster in vehicle.thrusters]
    defaults |= {f"SERVO{number}_FUNCTION": 0.0 for number in range(len(thrusts) + 1, MAX_MOTORS + 1)}
    defaults["HIL_THRUST"] = min(thrusts, default=0.0)
    names = ("FORCE_X", "FORCE_Y", "FORCE_Z", "MOMENT_K", "MOMENT_M", "MOMENT_N")
    for name, row in zip(names, rows, strict=True):
        most = sum(abs(share) * thrust for share, thrust in zip(row, thrusts, strict=True))
        defaults[f"HIL_{name}"] = round(MAX_SHARE * most, 1)
    return defaults


def motors_of(scenario: Scenario | None) -> list[tuple[int, int]]:
    """Return thruster, from 0, and direction (1, -1) of each motor of the vehicle's frame. Raises ConfigError."""
    return [(channel, sign) for _, channel, sign in _motors(scenario).motors] if scenario else []


def _motors(scenario: Scenario) -> MotorMap:
    """Return which thruster each motor of the vehicle's frame is, as ArduSub numbers them. Raises ConfigError."""
    vehicle, _ = load_vehicle(scenario.vehicle)
    try:
        return map_motors(AUTO, vehicle)
    except ConfigError:  # no frame of ArduSub
        return map_motors(CUSTOM, vehicle)
