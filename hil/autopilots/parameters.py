"""Read parameter files of autopilots, and derive parameters from a vehicle and its frame."""

import os
from collections.abc import Mapping
from types import MappingProxyType

from hil.autopilots.frames import AUTO, CUSTOM, MotorMap, load_frame, map_motors
from hil.common.errors import ConfigError
from hil.common.schema import preset_folder
from hil.links.address import parse_address
from hil.scenario.autopilot_records import AutopilotSettings
from hil.scenario.config import Scenario
from sim.sensors.sensor_set import SensorSet
from sim.vehicle.vehicle import Vehicle

FOLDER = "hil/autopilots/parameters"
ENDING = ".parm"
QGROUNDCONTROL_WORDS = 5  # of a line
UNDERWATER_VEHICLE = 7  # PX4's CA_AIRFRAME for a vehicle with motors in any pose
MOTOR_1 = 101  # PX4's output function of its first motor
MAX_ROTORS = 12
TOLERANCE = 2e-5  # of values that were rounded to text and to 32 bits, and of the offset that program.py adds
# PX4's functions for accessories (actuator set 1, gripper, pitch of a gimbal) at the outputs after its motors, and what
# starts its gripper, in some versions, and its gimbal, commanded by gimbal messages
PX4_ACCESSORIES = {MAX_ROTORS + 1: 301, MAX_ROTORS + 2: 430, MAX_ROTORS + 3: 421}
_PX4_DEVICES: dict[str, float] = {"PD_GRIPPER_EN": 1, "MNT_MODE_IN": 4}

Parameters = Mapping[str, float]
NO_SENSORS: SensorSet = MappingProxyType({})

# Parameters for ArduSub to use positions from a companion. Sources: 0 none, 1 barometer, 6 external navigation.
_EXTERNAL = {
    "SIM_GPS1_ENABLE": 0.0, "VISO_TYPE": 1.0, "EK3_SRC1_POSXY": 6.0, "EK3_SRC1_VELXY": 6.0, "EK3_SRC1_POSZ": 1.0,
    "EK3_SRC1_VELZ": 0.0,
}  # fmt: skip
_POSITIONS: dict[str, Parameters] = {
    "simulated": {},
    "odometry": _EXTERNAL,
    "dvl": _EXTERNAL,
    "gps": {"SIM_GPS1_ENABLE": 0.0, "GPS1_TYPE": 14.0},  # 14: MAVLink
}
# What PX4's estimator uses of ODOMETRY (1 horizontal position, 2 height, 4 velocity, 8 heading) and of HIL_GPS
# (1 position, 4 velocity). With both position and velocity of a solution whose position errors wander, its attitude
# tilts by 2 degrees. It would read the pressure of water as that of air. EKF2_EVV_NOISE: least standard deviation of
# velocities that it assumes, m/s; a DVL is better than PX4's default.
_HEIGHT_OF_ODOMETRY = {"EKF2_HGT_REF": 3, "EKF2_BARO_CTRL": 0, "EKF2_EVV_NOISE": 0.02}
_PX4_POSITIONS: dict[str, Parameters] = {
    name: {"EKF2_EV_CTRL": odometry, "EKF2_GPS_CTRL": gps, **_HEIGHT_OF_ODOMETRY}
    for name, (odometry, gps) in {"simulated": (11, 0), "odometry": (11, 0), "dvl": (6, 0), "gps": (2, 5)}.items()
}
# Prefixes of the parameters for the position of a sensor, to which X, Y or Z is appended; values in m. ArduPilot's own
# simulated GPS and a navigation solution are at the body origin. PX4's antenna: before version 1.18, and since.
_POSITION_PREFIXES: dict[str, dict[str, tuple[str, ...]]] = {
    "ardupilot": {
        "imu": ("INS_POS1_", "INS_POS2_", "INS_POS3_"), "altimeter": ("RNGFND1_POS_",), "dvl": ("VISO_POS_",),
        "gps": ("GPS1_POS_",),
    },
    "px4": {"imu": ("EKF2_IMU_POS_",), "dvl": ("EKF2_EV_POS_",), "gps": ("EKF2_GPS_POS_", "SENS_GPS0_OFF")},
}  # fmt: skip
_BY_POSITIONS = {"ardupilot": ("dvl", "gps"), "px4": ("dvl",)}  # sensors sent only if [autopilot] positions is theirs


def read_parameters(path: str) -> dict[str, float]:
    """Return the parameters of a file. A line has a name and a value, separated by blanks or a comma; # is a comment.

    It may also be a line of QGroundControl: vehicle, component, name, value, type. A number without a point is an
    integer. Raises ConfigError, which names the line.
    """
    try:
        with open(path, encoding="utf-8") as file:
            lines = file.read().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from None
    parameters: dict[str, float] = {}
    for number, line in enumerate(lines, 1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            name, value = words[2:4] if len(words) == QGROUNDCONTROL_WORDS else words
            parameters[name] = int(value) if value.lstrip("+-").isdecimal() else float(value)
        except ValueError:
            raise ConfigError(f"{path}: line {number}: expected NAME VALUE, found {line.strip()!r}") from None
        if not name.replace("_", "").isalnum() or len(name) > 16:
            raise ConfigError(
                f"{path}: line {number}: {name!r} is not a parameter name: at most 16 letters, digits and underscores"
            )
    return parameters


def parameter_file(settings: AutopilotSettings, controller: str, vehicle: Vehicle) -> str:
    """Return the path of the parameter file of the vehicle or of its autopilot, "" if none is given or installed.

    Raises ConfigError.
    """
    if settings.parameters.endswith((ENDING, ".params")):
        return settings.parameters
    names = [settings.parameters] if settings.parameters else [f"{controller}_{vehicle.name}", controller]
    for path in [os.path.join(preset_folder(FOLDER), name + ENDING) for name in names]:
        if os.path.exists(path):
            return path
    if not settings.parameters:
        return ""
    known = ", ".join(sorted(entry[: -len(ENDING)] for entry in os.listdir(preset_folder(FOLDER))))
    raise ConfigError(f"[autopilot] parameters: no file {settings.parameters!r}; use one of {known}, or a path")


def all_parameters(
    settings: AutopilotSettings, controller: str, vehicle: Vehicle, motors: MotorMap, sensors: SensorSet = NO_SENSORS
) -> Parameters:
    """Return the parameters to start the autopilot with.

    Those of its file override those derived from the frame, the source of positions and the mountings of sensors.
    """
    if controller == "ardupilot":
        own = {**ardusub_frame(motors), **_POSITIONS[settings.positions]}
        # ArduSub would simulate a battery of its own for a vehicle without one; 4: voltage and current
        own["SERIAL5_PROTOCOL"] = 2.0  # MAVLink, with the simulator as a companion
        own["BATT_MONITOR"] = 4.0 if "battery" in sensors else 0.0
    else:
        is_sitl = parse_address(settings.own_address(controller)).kind == "tcp"
        outputs = "PWM_MAIN" if is_sitl else "HIL_ACT"
        own = {**px4_geometry(vehicle, motors, outputs), **_PX4_POSITIONS[settings.positions]}
        if vehicle.accessories:
            own |= _PX4_DEVICES | {f"{outputs}_FUNC{number}": x for number, x in PX4_ACCESSORIES.items()}
    path = parameter_file(settings, controller, vehicle)
    return {**own, **sensor_positions(settings, controller, sensors), **(read_parameters(path) if path else {})}


def scenario_parameters(scenario: Scenario, vehicle: Vehicle) -> tuple[MotorMap, Parameters]:
    """Return the map of the scenario's motors, and the parameters to start its autopilot with. Raises ConfigError."""
    settings = scenario.autopilot or AutopilotSettings()
    has_own_geometry = scenario.controller == "px4" and settings.frame == AUTO  # PX4 gets it as parameters
    motors = map_motors(CUSTOM if has_own_geometry else settings.frame, vehicle)
    return motors, all_parameters(settings, scenario.controller, vehicle, motors, scenario.sensors)


def sensor_positions(settings: AutopilotSettings, controller: str, sensors: SensorSet) -> Parameters:
    """Return the parameters for positions of sensors, m from the body origin; none for sensors at the origin."""
    parameters: dict[str, float] = {}
    for name, prefixes in _POSITION_PREFIXES[controller].items():
        unused = name in _BY_POSITIONS[controller] and name != settings.positions
        if name not in sensors or unused or not any(sensors[name].mounting.position):
            continue
        for prefix in prefixes:
            for axis, place in zip("XYZ", sensors[name].mounting.position, strict=True):
                parameters[f"{prefix}{axis}"] = place
    return parameters


def ardusub_frame(motors: MotorMap) -> Parameters:
    """Return the parameters of ArduSub's frame; none for a custom one, which is compiled into ArduSub."""
    return {} if motors.frame == CUSTOM else {"FRAME_CONFIG": load_frame(motors.frame).frame_config}


def px4_geometry(vehicle: Vehicle, motors: MotorMap, outputs: str = "PWM_MAIN") -> Parameters:
    """Return PX4's control allocation of the motors: positions (m from the body origin) and directions (FRD).

    `outputs`: prefix of the parameters of PX4's outputs, HIL_ACT on a board. Raises ConfigError for more than
    MAX_ROTORS thrusters.
    """
    if len(vehicle.thrusters) > MAX_ROTORS:
        raise ConfigError(
            f"{vehicle.name}: has {len(vehicle.thrusters)} thrusters, but PX4 allocates at most {MAX_ROTORS}; "
            "use a vehicle with fewer"
        )
    parameters: dict[str, float] = {"CA_AIRFRAME": UNDERWATER_VEHICLE, "CA_ROTOR_COUNT": len(vehicle.thrusters)}
    parameters["CA_R_REV"] = (1 << len(vehicle.thrusters)) - 1  # all are reversible
    for output, channel, sign in motors.motors:
        if channel >= len(vehicle.thrusters):
            continue
        thruster = vehicle.thrusters[channel]
        for axis, place, along in zip("XYZ", thruster.position, thruster.unit_direction, strict=True):
            parameters[f"CA_ROTOR{output}_P{axis}"] = round(place, 5)
            parameters[f"CA_ROTOR{output}_A{axis}"] = round(sign * along, 5) + 0.0
        parameters[f"CA_ROTOR{output}_KM"] = 0.0
        parameters[f"{outputs}_FUNC{output + 1}"] = MOTOR_1 + output
    return parameters


def format_parameters(parameters: Parameters) -> str:
    """Return the text of a parameter file."""
    return "".join(f"{name} {number_text(value)}\n" for name, value in parameters.items())


def number_text(value: float) -> str:
    """Return the text of a parameter's value: an integer has no point, any other number has one."""
    return str(value) if isinstance(value, int) else repr(float(f"{value:.7g}"))
