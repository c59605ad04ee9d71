"""The messages that the vehicle takes and those that it refuses: the table by which they are dispatched."""

from typing import NamedTuple


class Taken(NamedTuple):
    """A message that is taken: its method, whether it changes something, and what it does."""

    handler: str
    changes: bool
    meaning: str


TAKEN: dict[str, Taken] = {
    "HEARTBEAT": Taken("heartbeat", False, "a ground station is there; the failsafe acts when it falls silent"),
    "PING": Taken("ping", False, "answered"),
    "TIMESYNC": Taken("timesync", False, "answered with the time since the gateway's start"),
    "COMMAND_LONG": Taken("command", False, "a command, see below"),
    "COMMAND_INT": Taken("command", False, "a command, see below"),
    "REQUEST_DATA_STREAM": Taken("data_stream", False, "the rate of a group of messages"),
    "PARAM_REQUEST_LIST": Taken("parameter_list", False, "all parameters"),
    "PARAM_REQUEST_READ": Taken("parameter_read", False, "one parameter"),
    "PARAM_SET": Taken("parameter_set", True, "sets a parameter"),
    "MISSION_REQUEST_LIST": Taken("mission_list", False, "downloads the mission"),
    "MISSION_REQUEST_INT": Taken("mission_item", False, "one item"),
    "MISSION_REQUEST": Taken("mission_item", False, "one item in the old form"),
    "MISSION_COUNT": Taken("mission_count", True, "uploads a mission"),
    "MISSION_ITEM_INT": Taken("mission_receive", True, "an item; with `current` 2 a place, 3 an altitude for Guided"),
    "MISSION_ITEM": Taken("mission_receive", True, "the same in the old form"),
    "MISSION_CLEAR_ALL": Taken("mission_clear", True, "removes the mission"),
    "MISSION_SET_CURRENT": Taken("mission_select", True, "goes on with that item"),
    "MISSION_ACK": Taken("ignore", False, "ends a download"),
    "FILE_TRANSFER_PROTOCOL": Taken("file", False, "MAVFTP: logs and the packed parameters"),
    "LOG_REQUEST_LIST": Taken("log_list", False, "answered with none: recordings are files of MAVFTP"),
    "SET_MODE": Taken("set_mode", True, "changes the mode"),
    "MANUAL_CONTROL": Taken("manual_control", True, "sticks and buttons of a joystick"),
    "RC_CHANNELS_OVERRIDE": Taken("rc_override", True, "channels 1 to 6: sticks; 7 pan, 8 tilt, 9 and 10 lights"),
    "SET_POSITION_TARGET_LOCAL_NED": Taken("local_target", True, "a target for Guided; a depth for Depth hold"),
    "SET_POSITION_TARGET_GLOBAL_INT": Taken("global_target", True, "a target for Guided; a depth for Depth hold"),
    "SET_ATTITUDE_TARGET": Taken("attitude_target", True, "a heading; roll and pitch stay level"),
    "SET_GPS_GLOBAL_ORIGIN": Taken("set_origin", True, "the origin of local coordinates"),
}  # fmt: skip
OWN_SENSORS = "position and sensors are the simulation's own"
REFUSED: dict[str, str] = {  # messages that others send to an autopilot, and why they change nothing here
    **dict.fromkeys(
        ("GPS_INPUT", "VISION_POSITION_ESTIMATE", "VISION_SPEED_ESTIMATE", "VISION_POSITION_DELTA",
         "GLOBAL_VISION_POSITION_ESTIMATE", "VICON_POSITION_ESTIMATE", "ATT_POS_MOCAP", "HIL_GPS", "HIL_SENSOR"),
        OWN_SENSORS,
    ),
    "SET_ACTUATOR_CONTROL_TARGET": "thrusters are driven by sticks, targets and DO_MOTOR_TEST",
    "MISSION_WRITE_PARTIAL_LIST": "upload the whole mission",
    "LOG_REQUEST_DATA": "recordings are files of MAVFTP, in /logs",
    "SETUP_SIGNING": "set signing_key in the section [mavlink]",
    "SERIAL_CONTROL": "there is no shell",
    "RALLY_POINT": "there are no rally points", "FENCE_POINT": "there is no fence",
}  # fmt: skip
GIVEN = ("DISTANCE_SENSOR", "ODOMETRY", "OPTICAL_FLOW", "LANDING_TARGET", "OBSTACLE_DISTANCE")
GROUND = 240  # systems from here on are no vehicles: what they send of GIVEN is meant for us, and refused
# What routers and ground stations send to everybody and to us without asking for anything
UNANSWERED = ("COMMAND_ACK", "PARAM_VALUE", "MISSION_CURRENT", "STATUSTEXT")
