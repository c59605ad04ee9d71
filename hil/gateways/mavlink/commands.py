"""Commands (COMMAND_LONG, COMMAND_INT): a function each. Every command is acknowledged; unknown ones as unsupported."""

from collections.abc import Callable
from math import isfinite, nan, radians
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.gateways.mavlink import calibration
from hil.gateways.mavlink.core import Core
from hil.gateways.mavlink.flight.mission_items import WAYPOINTS, read_item
from hil.gateways.mavlink.flight.modes import Mode
from hil.gateways.mavlink.flight.targets import GLOBAL_FRAMES, Target, TargetError, depth_of, earth_position
from hil.gateways.mavlink.snapshot import Origin
from hil.links.contract import LEAST_US, MOST_US

ACCEPTED: int = dialect.MAV_RESULT_ACCEPTED
REJECTED: int = dialect.MAV_RESULT_TEMPORARILY_REJECTED
DENIED: int = dialect.MAV_RESULT_DENIED
UNSUPPORTED: int = dialect.MAV_RESULT_UNSUPPORTED
THROTTLE_PERCENT, THROTTLE_PULSE = dialect.MOTOR_TEST_THROTTLE_PERCENT, dialect.MOTOR_TEST_THROTTLE_PWM
ONLY_DEPTH = 3
GO_TO = 2, ONLY_DEPTH  # MISSION_ITEM.current of an item that is flown at once
FAILED: int = dialect.MAV_RESULT_FAILED
GRAB = dialect.GRIPPER_ACTION_GRAB
PICTURES = "pictures are in the view, and in what uuv-hil recording make writes"
REFUSED: dict[int, str] = {
    **dict.fromkeys(
        (dialect.MAV_CMD_IMAGE_START_CAPTURE, dialect.MAV_CMD_VIDEO_START_CAPTURE, dialect.MAV_CMD_DO_DIGICAM_CONTROL),
        PICTURES,
    ),
    dialect.MAV_CMD_NAV_TAKEOFF: "a submarine dives by its sticks or by a target",
    dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH: "a submarine returns by DO_REPOSITION, or as an item of a mission",
    dialect.MAV_CMD_DO_FENCE_ENABLE: "there is no fence",
}  # fmt: skip


def command_name(number: int) -> str:
    """Return the name of a command, or its number."""
    entry = dialect.enums["MAV_CMD"].get(number)
    return str(entry.name).removeprefix("MAV_CMD_") if entry else f"command {number}"


class CommandRequest(NamedTuple):
    """A command of either form: seven parameters, x and y in degrees, and its frame."""

    command: int
    params: tuple[float, float, float, float, float, float, float]
    frame: int
    target_component: int = 0


def read_command(packet: Any) -> CommandRequest:
    """Return the command of a COMMAND_LONG or COMMAND_INT."""
    first = packet.param1, packet.param2, packet.param3, packet.param4
    if packet.get_msgId() == dialect.MAVLINK_MSG_ID_COMMAND_INT:
        last = packet.x * 1e-7, packet.y * 1e-7, packet.z
        return CommandRequest(packet.command, (*first, *last), packet.frame, packet.target_component)
    last = packet.param5, packet.param6, packet.param7
    return CommandRequest(packet.command, (*first, *last), dialect.MAV_FRAME_GLOBAL, packet.target_component)


class Commands:
    """The commands that change what the vehicle does. Those that only ask are answered in `dispatch`."""

    def __init__(self, core: Core) -> None:
        self._core = core
        self._table: dict[int, Callable[[CommandRequest, int], int]] = {
            dialect.MAV_CMD_DO_SET_MODE: self._set_mode,
            dialect.MAV_CMD_DO_SET_HOME: self._set_home,
            dialect.MAV_CMD_DO_REPOSITION: self._reposition,
            dialect.MAV_CMD_DO_CHANGE_SPEED: self._change_speed,
            dialect.MAV_CMD_CONDITION_YAW: self._turn_to_heading,
            dialect.MAV_CMD_MISSION_START: self._start_mission,
            dialect.MAV_CMD_DO_SET_MISSION_CURRENT: self._select_item,
            dialect.MAV_CMD_NAV_LAND: lambda _, now: core.set_mode(Mode.SURFACE),
            dialect.MAV_CMD_NAV_LOITER_UNLIM: lambda _, now: core.set_mode(Mode.POSHOLD),
            dialect.MAV_CMD_RUN_PREARM_CHECKS: self._check,
            dialect.MAV_CMD_DO_MOTOR_TEST: self._test_motor,
            **dict.fromkeys(calibration.COMMANDS, self._calibrate),
            dialect.MAV_CMD_PREFLIGHT_STORAGE: self._storage,
            dialect.MAV_CMD_DO_SET_SERVO: self._set_servo,
            dialect.MAV_CMD_DO_SET_RELAY: self._set_relay,
            dialect.MAV_CMD_DO_GRIPPER: self._grip,
            dialect.MAV_CMD_DO_MOUNT_CONTROL: self._turn_camera,
            dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: self._turn_camera,
            dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: self._restart,
        }

    def numbers(self) -> list[int]:
        """Return the commands (MAV_CMD) that are known."""
        return [dialect.MAV_CMD_COMPONENT_ARM_DISARM, *self._table]

    def execute(self, request: CommandRequest, now: int, settled: Callable[[int], None]) -> None:
        """Do a command; `settled` gets its MAV_RESULT, that of arming perhaps later."""
        if request.command == dialect.MAV_CMD_COMPONENT_ARM_DISARM:
            self._arm(request, now, settled)
            return
        do = self._table.get(request.command)
        if do is None:
            name, reason = command_name(request.command), REFUSED.get(request.command, "this vehicle has no use for it")
            if not name.startswith("REQUEST_"):  # ground stations ask everybody when they connect
                self._core.complain(f"{name} is not supported: {reason}", now)
            settled(UNSUPPORTED)
            return
        try:
            settled(do(request, now))
        except TargetError as error:
            self._core.texts.append((4, str(error)))
            settled(DENIED)

    def _arm(self, request: CommandRequest, now: int, settled: Callable[[int], None]) -> None:
        requested = request.params[0]
        if requested == 1.0:
            self._core.arm(now, settled)
        elif requested == 0.0:
            self._core.disarm()
            settled(ACCEPTED)
        else:
            settled(DENIED)

    def _set_mode(self, request: CommandRequest, now: int) -> int:
        flags, mode = request.params[:2]
        if not (isfinite(flags) and int(flags) & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED):
            return DENIED
        return self._core.set_mode(mode)

    def _set_home(self, request: CommandRequest, _: int) -> int:
        core, (latitude, longitude) = self._core, request.params[4:6]
        if request.params[0] == 1.0:
            if core.snapshot is None:
                return REJECTED
            north, east, _depth = core.snapshot.state.position
            core.set_home((north, east, 0.0))
            return ACCEPTED
        core.set_home(earth_position(latitude * 1e7, longitude * 1e7, 0.0, core.origin))
        return ACCEPTED

    def _reposition(self, request: CommandRequest, now: int) -> int:
        """Go to a place on the earth in mode Guided; param2 bit 0 permits the change of mode."""
        core, snapshot = self._core, self._core.snapshot
        relative = GLOBAL_FRAMES.get(request.frame)
        if relative is None:
            return DENIED
        if snapshot is None:
            return REJECTED
        speed, flags, _, yaw, latitude, longitude, altitude = request.params
        if core.pilot.mode != Mode.GUIDED:
            if not (isfinite(flags) and int(flags) & 1):
                return DENIED
            core.set_mode(Mode.GUIDED)
        north, east, depth = core.pilot.target_position or snapshot.state.position
        if isfinite(latitude) and isfinite(longitude):
            north, east, _ = earth_position(latitude * 1e7, longitude * 1e7, 0.0, core.origin)
        if isfinite(altitude):
            depth = max(0.0, depth_of(altitude, relative, core.origin, core.home[2]))
        heading = radians(yaw) if isfinite(yaw) else None
        wanted = min(speed, 5.0) if isfinite(speed) and speed > 0.0 else None
        return self._follow(Target((north, east, depth), None, heading, 0.0, wanted), now)

    def go_to(self, packet: Any, now: int) -> int:
        """Go to the place of a MISSION_ITEM(_INT) with current 2, or to its depth with 3; return a MAV_MISSION_RESULT.

        Ground stations send one on its own, for mode Guided.
        """
        item = read_item(packet)
        if item is None or item.command not in WAYPOINTS:
            return int(dialect.MAV_MISSION_UNSUPPORTED if item else dialect.MAV_MISSION_INVALID)
        if self._core.pilot.mode != Mode.GUIDED:
            self._core.texts.append((4, "go to: only in mode Guided"))
            return int(dialect.MAV_MISSION_DENIED)
        place = (nan, nan) if packet.current == ONLY_DEPTH else (item.x * 1e-7, item.y * 1e-7)
        request = CommandRequest(0, (-1.0, 0.0, 0.0, item.params[3] or nan, *place, item.z), item.frame)
        try:
            is_accepted = self._reposition(request, now) == ACCEPTED
        except TargetError as error:
            self._core.texts.append((4, f"go to: {error}"))
            return int(dialect.MAV_MISSION_INVALID_PARAM5_X)
        return int(dialect.MAV_MISSION_ACCEPTED if is_accepted else dialect.MAV_MISSION_ERROR)

    def _follow(self, target: Target, now: int) -> int:
        """Follow a target in mode Guided, if the vehicle is armed."""
        reason = self._core.pilot.set_target(target, now)
        if reason:
            self._core.complain(reason, now)
        return REJECTED if reason else ACCEPTED

    def _change_speed(self, request: CommandRequest, _: int) -> int:
        speed = request.params[1]
        if not isfinite(speed) or speed <= 0.0:
            return DENIED
        return FAILED if self._core.table.set("WPNAV_SPEED", 100.0 * speed) else ACCEPTED

    def _turn_to_heading(self, request: CommandRequest, now: int) -> int:
        """Turn on the spot in mode Guided."""
        core, snapshot = self._core, self._core.snapshot
        angle, _, direction, relative = request.params[:4]
        if snapshot is None or core.pilot.mode != Mode.GUIDED:
            return REJECTED
        if not isfinite(angle):
            return DENIED
        turn = radians(angle)
        heading = snapshot.state.heading + (-turn if direction < 0.0 else turn) if relative == 1.0 else turn
        place = core.pilot.target_position or snapshot.state.position
        return self._follow(Target(place, None, heading), now)

    def _start_mission(self, request: CommandRequest, now: int) -> int:
        first = request.params[0]
        if isfinite(first) and first > 0.0 and not self._core.flight.select(int(first)):
            return DENIED
        return self._core.set_mode(Mode.AUTO)

    def _select_item(self, request: CommandRequest, _: int) -> int:
        index = request.params[0]
        return ACCEPTED if isfinite(index) and self._core.flight.select(int(index)) else DENIED

    def _test_motor(self, request: CommandRequest, now: int) -> int:
        """Turn one motor of the armed vehicle for a moment, numbered from 0 as the frame's outputs are."""
        core, (number, kind, throttle, _, _, order, _) = self._core, request.params
        pulse = {THROTTLE_PERCENT: 1100.0 + 8.0 * throttle, THROTTLE_PULSE: throttle}.get(kind)
        if not core.pilot.armed:
            core.texts.append((4, "Arm motors before testing motors."))
        elif order != dialect.MOTOR_TEST_ORDER_BOARD or pulse is None or not 1100.0 <= pulse <= 1900.0:
            core.texts.append((4, "motor test: only by outputs of the board, in 0 to 100 % or 1100 to 1900 us"))
        elif not core.test_motor(number, (pulse - 1500.0) / 400.0, now):
            core.texts.append((4, f"motor test: no motor {number + 1.0:g}"))
        else:
            return ACCEPTED
        return FAILED

    def _calibrate(self, request: CommandRequest, _: int) -> int:
        if self._core.pilot.armed:
            self._core.texts.append((4, "Disarm to allow calibration"))
            return FAILED
        texts, messages = calibration.answer(request.command, request.params)
        self._core.texts.extend([(6, text) for text in texts])
        self._core.messages.extend(messages)
        return ACCEPTED

    def _check(self, _: CommandRequest, now: int) -> int:
        self._core.forget_obstacle()
        return ACCEPTED

    def _set_servo(self, request: CommandRequest, now: int) -> int:
        output, pulse = request.params[:2]
        if isfinite(output) and self._core.accessories.set_pulse(int(output), pulse):
            return ACCEPTED
        self._core.complain(f"no servo at output {output:g}: thrusters turn by sticks and DO_MOTOR_TEST", now)
        return FAILED

    def _set_relay(self, request: CommandRequest, _: int) -> int:
        number, on = request.params[:2]
        return ACCEPTED if isfinite(number) and self._core.accessories.switch(int(number), on > 0.0) else DENIED

    def _grip(self, request: CommandRequest, _: int) -> int:
        self._core.accessories.set_named("Gripper", LEAST_US if request.params[1] == GRAB else MOST_US)
        return ACCEPTED

    def _turn_camera(self, request: CommandRequest, _: int) -> int:
        """Tilt and pan the camera: in degrees, up and to starboard. Angles that are nan stay as they are."""
        is_mount = request.command == dialect.MAV_CMD_DO_MOUNT_CONTROL
        tilt, pan = request.params[0], request.params[2 if is_mount else 1]
        for name, angle in (("CamTilt", tilt), ("CamPan", pan)):
            if isfinite(angle):
                self._core.accessories.turn_to(name, angle)
        return ACCEPTED

    def _restart(self, request: CommandRequest, now: int) -> int:
        """Begin again with mode Manual, centred accessories and no mission's progress, as after a reboot."""
        if self._core.pilot.armed:
            self._core.complain("reboot: disarm first", now)
            return DENIED
        if request.params[0] != 1.0:
            return UNSUPPORTED
        self._core.restart()
        return ACCEPTED

    def _storage(self, request: CommandRequest, _: int) -> int:
        """Accept to store parameters, which are stored as they are set; refuse to reset them."""
        return ACCEPTED if request.params[0] in (0.0, 1.0) else UNSUPPORTED


def origin_of(packet: Any) -> Origin | None:
    """Return the origin of SET_GPS_GLOBAL_ORIGIN, None for one that cannot be."""
    if abs(packet.latitude) > 90 * 10**7 or abs(packet.longitude) > 180 * 10**7 or abs(packet.altitude) > 10**7:
        return None
    return Origin(packet.latitude * 1e-7, packet.longitude * 1e-7, packet.altitude * 1e-3)
