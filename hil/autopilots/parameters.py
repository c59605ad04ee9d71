"""Parameter files of autopilots, and the values that follow from a vehicle and its frame."""

import os
from collections.abc import Mapping
from types import MappingProxyType

from hil.autopilots.frames import CUSTOM, MotorMap, load_frame
from hil.common.errors import ConfigError
from hil.common.schema import preset_folder
from hil.scenario.autopilot_records import AutopilotSettings
from sim.sensors.sensor_set import SensorSet
from sim.vehicle.vehicle import Vehicle

FOLDER = "hil/autopilots/parameters"
ENDING = ".parm"
UNDERWATER_VEHICLE = 7  # PX4's CA_AIRFRAME of a vehicle with motors in any pose
MOTOR_1 = 101  # PX4's output function of its first motor
MOST_ROTORS = 12

Parameters = Mapping[str, float]
NO_SENSORS: SensorSet = MappingProxyType({})

# What makes ArduSub take its position of a companion's messages. Sources: 0 none, 1 barometer, 6 external navigation.
_EXTERNAL = {
    "SIM_GPS1_ENABLE": 0.0, "VISO_TYPE": 1.0, "EK3_SRC1_POSXY": 6.0, "EK3_SRC1_VELXY": 6.0, "EK3_SRC1_POSZ": 1.0,
    "EK3_SRC1_VELZ": 0.0,
}  # fmt: skip
_POSITIONS: dict[str, Parameters] = {
    "simulated": {},
    "odometry": _EXTERNAL,
    "dvl": _EXTERNAL,
    "gps": {"SIM_GPS1_ENABLE": 0.0, "GPS1_TYPE": 14.0},  # 14: by MAVLink
}
# Parameters of an autopilot for the place of a sensor, each followed by X, Y or Z in m. Its own simulated GPS is at the
# body origin, and so is a navigation solution. PX4's antenna: before and since 1.18.
_PLACES: dict[str, dict[str, tuple[str, ...]]] = {
    "ardupilot": {
        "imu": ("INS_POS1_", "INS_POS2_", "INS_POS3_"), "altimeter": ("RNGFND1_POS_",), "dvl": ("VISO_POS_",),
        "gps": ("GPS1_POS_",),
    },
    "px4": {"imu": ("EKF2_IMU_POS_",), "gps": ("EKF2_GPS_POS_", "SENS_GPS0_OFF")},
}  # fmt: skip
_BY_POSITIONS = ("dvl", "gps")  # sensors that ArduPilot gets only where [autopilot] positions says so


def read_parameters(path: str) -> dict[str, float]:
    """Return the parameters of a file: a name and a value a line, apart by blanks or a comma; # begins a comment.

    Raises ConfigError that names the line.
    """
    try:
        with open(path, encoding="utf-8") as file:
            lines = file.read().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from None
    parameters = {}
    for number, line in enumerate(lines, 1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            name, value = words
            parameters[name] = float(value)
        except ValueError:
            raise ConfigError(f"{path}: line {number}: expected NAME VALUE, found {line.strip()!r}") from None
        if not name.replace("_", "").isalnum() or len(name) > 16:
            raise ConfigError(f"{path}: line {number}: {name!r} is no name of a parameter")
    return parameters


def parameter_file(settings: AutopilotSettings, controller: str, vehicle: Vehicle) -> str:
    """Return the path of the vehicle's parameters; "" if none are given and none are installed. Raises ConfigError."""
    if settings.parameters.endswith(ENDING):
        return settings.parameters
    name = settings.parameters or f"{controller}_{vehicle.name}"
    path = os.path.join(preset_folder(FOLDER), name + ENDING)
    if os.path.exists(path):
        return path
    if not settings.parameters:
        return ""
    known = ", ".join(sorted(entry[: -len(ENDING)] for entry in os.listdir(preset_folder(FOLDER))))
    raise ConfigError(f"[autopilot] parameters: no file {settings.parameters!r}; there are: {known}, or a path")


def all_parameters(
    settings: AutopilotSettings, controller: str, vehicle: Vehicle, motors: MotorMap, sensors: SensorSet = NO_SENSORS
) -> Parameters:
    """Return what the autopilot is started with: its file over what follows from frame, positions and mountings."""
    if controller == "ardupilot":
        own = {**ardusub_frame(motors), **_POSITIONS[settings.positions]}
    else:
        own = dict(px4_geometry(vehicle, motors))
    path = parameter_file(settings, controller, vehicle)
    return {**own, **sensor_places(settings, controller, sensors), **(read_parameters(path) if path else {})}


def sensor_places(settings: AutopilotSettings, controller: str, sensors: SensorSet) -> Parameters:
    """Return where the sensors are that the autopilot reads: m from the body origin; none for those that are there."""
    parameters: dict[str, float] = {}
    for name, prefixes in _PLACES[controller].items():
        unused = controller == "ardupilot" and name in _BY_POSITIONS and name != settings.positions
        if name not in sensors or unused or not any(sensors[name].mounting.position):
            continue
        for prefix in prefixes:
            for axis, place in zip("XYZ", sensors[name].mounting.position, strict=True):
                parameters[f"{prefix}{axis}"] = place
    return parameters


def ardusub_frame(motors: MotorMap) -> Parameters:
    """Return the parameters of ArduSub's frame; none for a custom one, which ArduSub has compiled in."""
    return {} if motors.frame == CUSTOM else {"FRAME_CONFIG": load_frame(motors.frame).frame_config}


def px4_geometry(vehicle: Vehicle, motors: MotorMap) -> Parameters:
    """Return PX4's control allocation for the motors: places in m from the body origin, and directions (FRD)."""
    if len(vehicle.thrusters) > MOST_ROTORS:
        raise ConfigError(
            f"{vehicle.name}: {len(vehicle.thrusters)} thrusters, and PX4 allocates to {MOST_ROTORS}; "
            "give the vehicle file fewer"
        )
    parameters: dict[str, float] = {"CA_AIRFRAME": UNDERWATER_VEHICLE, "CA_ROTOR_COUNT": len(vehicle.thrusters)}
    parameters["CA_R_REV"] = (1 << len(vehicle.thrusters)) - 1  # all turn both ways
    for output, channel, sign in motors.motors:
        if channel >= len(vehicle.thrusters):
            continue
        thruster = vehicle.thrusters[channel]
        for axis, place, along in zip("XYZ", thruster.position, thruster.unit_direction, strict=True):
            parameters[f"CA_ROTOR{output}_P{axis}"] = round(place, 5)
            parameters[f"CA_ROTOR{output}_A{axis}"] = round(sign * along, 5) + 0.0
        parameters[f"CA_ROTOR{output}_KM"] = 0.0
        parameters[f"PWM_MAIN_FUNC{output + 1}"] = MOTOR_1 + output
    return parameters


def format_parameters(parameters: Parameters) -> str:
    """Return parameters as the text of a file."""
    return "".join(f"{name} {value:g}\n" for name, value in parameters.items())
