"""What scripts and ground stations of BlueROV2 users send, and what it means to the vehicle: a row a request."""

import math
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.quaternion import QuaternionBase

from hil.gateways.mavlink.flight.modes import Mode
from hil.gateways.mavlink.peer import Peer
from tests.support.clients.mavlink_vehicle import Bench

ACCEPTED, UNSUPPORTED = dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_UNSUPPORTED


def test_channels_of_accessories_follow_those_of_the_sticks() -> None:
    bench = Bench()
    assert bench.partner.command(SERVO, 12, 1300) == ACCEPTED
    assert bench.partner.command(dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_RC_CHANNELS) == ACCEPTED
    (found,) = bench.partner.take_messages("RC_CHANNELS")
    assert [getattr(found, f"chan{n}_raw") for n in range(1, 12)] == [*[1500] * 7, 1300, 1100, 1100, 0]


def test_a_slow_line_gets_each_message_once_a_second_at_first() -> None:
    slow, fast = [Peer(1, "", 1, lambda *_: None, True, burst).rates for burst in (399, 400)]
    for name, usual_us in (("ATTITUDE", 100_000), ("RAW_IMU", 250_000), ("HOME_POSITION", 10_000_000)):
        number = getattr(dialect, f"MAVLINK_MSG_ID_{name}")
        assert (slow.interval_us(number), fast.interval_us(number)) == (max(usual_us, 1_000_000), usual_us)


def _override(**channels: int) -> Any:
    values = [channels.get(f"c{number}", 0xFFFF) for number in range(1, 19)]
    return dialect.MAVLink_rc_channels_override_message(1, 1, *values)


def _buttons(*numbers: int) -> Any:
    mask = sum(1 << number for number in numbers)
    return dialect.MAVLink_manual_control_message(1, 0, 0, 500, 0, mask & 0xFFFF, buttons2=mask >> 16)


def _depth(altitude: float) -> Any:
    frame = dialect.MAV_FRAME_GLOBAL_INT
    return dialect.MAVLink_set_position_target_global_int_message(
        0, 1, 1, frame, 0b110111111011, 0, 0, altitude, 0, 0, 0, 0, 0, 0, 0, 0
    )


def _attitude(yaw: float, pitch: float = 0.0) -> Any:
    q = QuaternionBase([0.0, math.radians(pitch), math.radians(yaw)])
    return dialect.MAVLink_set_attitude_target_message(0, 1, 1, 1 << 6, list(q), 0.0, 0.0, 0.0, 0.0)


def _item(current: int, z: float) -> Any:
    return dialect.MAVLink_mission_item_message(1, 1, 0, 3, 16, current, 1, 0, 0, 0, 0, 45.0001, 10.0, z)


def _command(number: int, *params: float) -> Any:
    return dialect.MAVLink_command_long_message(1, 1, number, 0, *params, *[0.0] * (7 - len(params)))


SERVO, MOUNT = dialect.MAV_CMD_DO_SET_SERVO, dialect.MAV_CMD_DO_MOUNT_CONTROL
PITCH_YAW, GRIPPER = dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, dialect.MAV_CMD_DO_GRIPPER
DEPTH_HOLD, NAN = Mode.ALT_HOLD, math.nan

REQUESTS: dict[str, tuple[Mode, Any, str, Any]] = {  # mode, what is sent, what it changes, and to which value
    "channel 5 drives ahead": (Mode.MANUAL, _override(c5=1700), "push", (20.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
    "channel 6 drives sideways": (Mode.MANUAL, _override(c6=1300), "push", (0.0, -20.0, 0.0, 0.0, 0.0, 0.0)),
    "channel 3 drives up": (Mode.MANUAL, _override(c3=1900), "push", (0.0, 0.0, -40.0, 0.0, 0.0, 0.0)),
    "channel 4 turns": (Mode.MANUAL, _override(c4=1700), "push", (0.0, 0.0, 0.0, 0.0, 0.0, 4.0)),
    "channel 8 tilts the camera": (Mode.MANUAL, _override(c8=1900), "camera_tilt", 1.0),
    "channel 9 switches lights on": (Mode.MANUAL, _override(c9=1900), "lights", 1.0),
    "group 99 of messages": (
        Mode.MANUAL, dialect.MAVLink_request_data_stream_message(1, 1, 99, 4, 1), "text", "REQUEST_DATA_STREAM 99: no",
    ),
    "channel 14 moves nothing": (Mode.MANUAL, _override(c14=1900), "text", "RC channel 14 moves nothing"),
    "button 2 holds the depth": (Mode.MANUAL, _buttons(2), "mode", Mode.ALT_HOLD),
    "button 3 stabilizes": (Mode.MANUAL, _buttons(3), "mode", Mode.STABILIZE),
    "button 4 disarms": (Mode.MANUAL, _buttons(4), "armed", False),
    "button 14 brightens": (Mode.MANUAL, _buttons(14), "lights", 0.125),
    "button 7 centres": (Mode.MANUAL, _buttons(7), "camera_tilt", 0.0),
    "button 12 lowers the gain": (Mode.MANUAL, _buttons(12), "gain", 0.75),
    "shifted button 14": (Mode.MANUAL, _buttons(5, 14), "text", "BTN14_SFUNCTION 44 is not supported"),
    "a depth in Depth hold": (DEPTH_HOLD, _depth(-3.0), "depth", 3.0),
    "a depth in Guided": (Mode.GUIDED, _depth(-3.0), "depth", 3.0),
    "a depth in Manual": (Mode.MANUAL, _depth(-3.0), "text", "mode Manual follows none"),
    "a depth in Stabilize": (Mode.STABILIZE, _depth(-3.0), "text", "holds no depth"),
    "a heading in Depth hold": (DEPTH_HOLD, _attitude(150.0), "heading", 150.0),
    "a heading in Guided": (Mode.GUIDED, _attitude(-60.0), "heading", -60.0),
    "a pitch": (DEPTH_HOLD, _attitude(0.0, pitch=20.0), "text", "roll and pitch stay level"),
    "an item to go to": (Mode.GUIDED, _item(2, -4.0), "place", (11.1, 0.0, 4.0)),
    "an altitude to go to": (Mode.GUIDED, _item(3, -4.0), "place", (0.0, 0.0, 4.0)),
    "an item to go to in Manual": (Mode.MANUAL, _item(2, -4.0), "text", "only in mode Guided"),
    "lights by servo": (Mode.MANUAL, _command(SERVO, 9, 1500), "lights", 0.5),
    "gripper by servo": (Mode.MANUAL, _command(SERVO, 11, 1900), "gripper", 1.0),
    "a thruster as servo": (Mode.MANUAL, _command(SERVO, 3, 1900), "text", "no servo at output 3"),
    "gripper grabs": (Mode.MANUAL, _command(GRIPPER, 1, dialect.GRIPPER_ACTION_GRAB), "gripper", -1.0),
    "mount": (Mode.MANUAL, _command(MOUNT, -22.5, 0, 0), "camera_tilt", -0.5),
    "gimbal": (Mode.MANUAL, _command(PITCH_YAW, 45.0, NAN), "camera_tilt", 1.0),
    "a picture": (Mode.MANUAL, _command(dialect.MAV_CMD_IMAGE_START_CAPTURE), "text", "IMAGE_START_CAPTURE is not"),
    "an unknown command": (Mode.MANUAL, _command(518), "text", "is not supported: this vehicle has no use"),
    "takeoff": (Mode.MANUAL, _command(dialect.MAV_CMD_NAV_TAKEOFF), "text", "a submarine dives"),
    "return home": (Mode.GUIDED, _command(dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH), "text", "returns by DO_REPOSITION"),
    "reboot while armed": (Mode.MANUAL, _command(246, 1), "text", "disarm first"),
    "an external position": (
        Mode.MANUAL, dialect.MAVLink_vision_position_estimate_message(0, 0, 0, 0, 0, 0, 0), "text", "simulation's own",
    ),
    "a distance of a companion": (
        Mode.MANUAL, dialect.MAVLink_distance_sensor_message(0, 10, 40, 20, 0, 1, 25, 0), "text", "simulation's own",
    ),
    "a message of no use": (
        Mode.MANUAL, dialect.MAVLink_log_erase_message(1, 1), "text", "LOG_ERASE is not taken",
    ),
}  # fmt: skip


def _value(bench: Bench, what: str) -> Any:
    pilot = bench.core.pilot
    values: dict[str, Callable[[], Any]] = {
        "push": bench.vehicle.pushed, "mode": lambda: pilot.mode, "armed": lambda: pilot.armed,
        "gain": lambda: pilot.joystick.gain, "depth": lambda: bench.vehicle.depth,
        "heading": lambda: math.degrees(bench.vehicle.heading), "text": bench.partner.texts,
        "place": lambda: (bench.vehicle.north, bench.vehicle.east, bench.vehicle.depth),
    }  # fmt: skip
    return values[what]() if what in values else bench.vehicle.accessories[what]


@pytest.mark.parametrize("name", REQUESTS)
def test_requests_of_scripts_do_what_they_mean_or_are_refused_in_words(name: str) -> None:
    mode, message, what, expected = REQUESTS[name]
    bench = Bench()
    bench.arm(mode)
    bench.run(0.2)
    bench.partner.take_messages("STATUSTEXT")
    bench.partner.send(message)
    bench.run(0.5 if what in ("push", "text") else 40.0 if what == "place" else 12.0)
    value = _value(bench, what)
    if what == "text":
        assert expected in value.replace(" | ", "")
    else:
        assert value == pytest.approx(expected, abs=0.3 if what == "place" else 0.01)


def test_sticks_and_targets_of_a_disarmed_vehicle_are_refused_in_words() -> None:
    bench = Bench()
    assert bench.partner.command(dialect.MAV_CMD_DO_SET_MODE, 1, Mode.GUIDED) == ACCEPTED
    bench.partner.send(_override(c5=1900, c6=1900))
    bench.partner.send(_depth(-3.0))
    bench.run(4.0)
    for deflection in (0, 900, 900):  # centred sticks ask for nothing, the other ones are refused once a minute
        bench.partner.send(dialect.MAVLink_manual_control_message(1, deflection, 0, 500, 0, 0))
        bench.run(15.0)
    texts = bench.partner.texts()
    assert texts.count("sticks move nothing: arm first") == 1
    assert "RC channels 1 to 6 move nothing: arm first" in texts
    assert "RC channel 6 " not in texts
    assert "target: arm first" in texts


def test_sticks_by_rc_channels_end_after_their_time() -> None:
    bench = Bench()
    bench.arm()
    bench.partner.send(_override(c5=1900))
    bench.run(2.5)
    assert bench.vehicle.pushed()[0] == 40.0
    bench.partner.send(_override(c5=0))  # released
    bench.run(0.1)
    assert bench.vehicle.pushed()[0] == 0.0
    bench.partner.send(_override(c5=1900))
    bench.run(3.3)
    assert bench.vehicle.pushed()[0] == 0.0
    bench.partner.send(_override(c4=1900))  # what expired does not come back
    bench.run(0.1)
    assert bench.vehicle.pushed()[0] == 0.0


def test_input_hold_holds_until_the_sticks_were_centred() -> None:
    bench = Bench()
    bench.arm()

    def drive(x: int, buttons: int = 0) -> float:
        bench.partner.send(dialect.MAVLink_manual_control_message(1, x, 0, 500, 0, buttons))
        bench.run(0.1)
        return bench.vehicle.pushed()[0]

    assert [drive(500), drive(500, 1 << 8), drive(700), drive(0), drive(250)] == [20.0, 20.0, 20.0, 20.0, 30.0]
    assert [drive(0, 1 << 8), drive(0), "Input Hold Disabled" in bench.partner.texts()] == [20.0, 0.0, True]


def test_an_origin_is_confirmed_also_the_same_again_and_another_is_refused() -> None:
    bench = Bench(origin=None)
    home = dialect.MAV_CMD_GET_HOME_POSITION
    assert bench.partner.command(home) == dialect.MAV_RESULT_TEMPORARILY_REJECTED
    for _ in range(2):
        bench.partner.send(dialect.MAVLink_set_gps_global_origin_message(1, 500000000, 80000000, 0))
        assert [message.latitude for message in bench.partner.take_messages("GPS_GLOBAL_ORIGIN")] == [500000000]
    assert bench.partner.command(home) == ACCEPTED
    bench.partner.send(dialect.MAVLink_set_gps_global_origin_message(1, 510000000, 80000000, 0))
    bench.run(0.1)
    assert bench.partner.take_messages("GPS_GLOBAL_ORIGIN") == []
    assert "origin: not taken" in bench.partner.texts()


def test_an_item_that_is_too_far_away_is_refused_in_words() -> None:
    bench = Bench()
    bench.partner.send(dialect.MAVLink_mission_count_message(1, 1, 2, 0))
    for seq in range(2):
        bench.partner.send(
            dialect.MAVLink_mission_item_int_message(1, 1, seq, 3, 16, 0, 1, 0, 0, 0, 0, 800000000, 100000000, -2.0)
        )
    bench.run(0.1)
    assert "mission: item 1 is refused: INVALID_PARAM5_X" in bench.partner.texts()


def test_the_panel_has_what_the_pilot_sees() -> None:
    bench = Bench()
    bench.partner.send(_command(SERVO, 9, 1700))
    bench.run(1.0)
    rows = {row.name: row.value for row in bench.partner.take_messages("NAMED_VALUE_FLOAT")}
    shares = {"CamTilt": 0.5, "CamPan": 0.5, "Lights1": 0.75, "Lights2": 0.0, "PilotGain": 1.0}
    assert rows == shares | dict.fromkeys(("InputHold", "RollPitch", "TetherTrn"), 0.0)
    pulses = bench.partner.take_messages("SERVO_OUTPUT_RAW")[-1].pulses
    assert [*pulses[:9]] == [1500] * 6 + [0, 0, 1700]


COCKPIT_MESSAGES = (  # whose rates Cockpit sets when it connects, by its file of defaults (2026)
    "RAW_IMU", "SCALED_IMU2", "SCALED_IMU3", "SCALED_PRESSURE", "SCALED_PRESSURE2", "SYS_STATUS", "POWER_STATUS",
    "GPS_RAW_INT", "NAV_CONTROLLER_OUTPUT", "GLOBAL_POSITION_INT", "SERVO_OUTPUT_RAW", "RC_CHANNELS", "ATTITUDE",
    "AHRS2", "VFR_HUD", "AHRS", "SYSTEM_TIME", "RANGEFINDER", "DISTANCE_SENSOR", "BATTERY_STATUS",
    "GIMBAL_DEVICE_ATTITUDE_STATUS", "EKF_STATUS_REPORT", "VIBRATION",
)  # fmt: skip
NOT_OF_A_SUBMARINE = ("MEMINFO", "GPS2_RAW", "FENCE_STATUS", "PID_TUNING", "MAG_CAL_REPORT")


def test_cockpit_connects_without_a_remark_and_gets_its_rates() -> None:
    bench = Bench()
    bench.partner.heartbeat()
    bench.partner.send(dialect.MAVLink_param_request_list_message(1, 0))
    bench.partner.send(dialect.MAVLink_system_time_message(1, 1))
    bench.partner.send(dialect.MAVLink_timesync_message(0, 5))
    bench.partner.send(dialect.MAVLink_mission_request_list_message(1, 1, 0))
    for names, result in ((COCKPIT_MESSAGES, ACCEPTED), (NOT_OF_A_SUBMARINE, dialect.MAV_RESULT_DENIED)):
        for name in names:
            number = getattr(dialect, f"MAVLINK_MSG_ID_{name}")
            assert bench.partner.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, number, 500_000) == result, name
    bench.run(4.0)
    assert 7 <= len(bench.partner.take_messages("AHRS2")) <= 9
    assert bench.partner.take_messages("TIMESYNC")[0].ts1 == 5
    received = {value.param_id for value in bench.partner.take_messages("PARAM_VALUE")}
    assert {f"BTN{button}_{kind}" for button in range(32) for kind in ("FUNCTION", "SFUNCTION")} < received
    assert bench.partner.texts() == ""


def test_what_asks_nothing_of_this_vehicle_gets_no_answer() -> None:
    bench = Bench()
    bench.add_partner(239).send(REQUESTS["a distance of a companion"][1])  # of another vehicle
    for message in (
        dialect.MAVLink_command_ack_message(1, 0, 0, 0, 1, 1), dialect.MAVLink_log_erase_message(0, 0),
        dialect.MAVLink_ping_message(1, 2, 1, 1), _command(dialect.MAV_CMD_REQUEST_CAMERA_INFORMATION),
    ):  # fmt: skip
        bench.partner.send(message)
    bench.run(0.1)
    assert (bench.partner.texts(), bench.partner.take_messages("PING")) == ("", [])


def test_a_second_sender_of_sticks_is_told_who_holds_them() -> None:
    bench = Bench()
    bench.add_partner(254).sticks()
    for message in (_override(c5=1900), _buttons()):
        for stale in (True, False):  # what has waited is ignored
            bench.dispatcher.stale = stale
            bench.core._complaints.clear()
            bench.partner.send(message)
            bench.run(0.02)
            assert ("another sender holds the sticks" in bench.partner.texts()) == (not stale)


def test_the_old_message_sets_the_mode_and_is_acknowledged_as_both() -> None:
    bench = Bench()
    for mode, result in ((Mode.STABILIZE, ACCEPTED), (99, dialect.MAV_RESULT_DENIED)):
        bench.partner.send(dialect.MAVLink_set_mode_message(1, 1, mode))
        acks = [(ack.command, ack.result) for ack in bench.partner.take_messages("COMMAND_ACK")]
        assert acks == [(dialect.MAVLINK_MSG_ID_SET_MODE, result), (dialect.MAV_CMD_DO_SET_MODE, result)]
        assert bench.core.pilot.mode == Mode.STABILIZE


@pytest.mark.parametrize(
    ("mode", "fields", "result"),
    [
        (Mode.GUIDED, {}, dialect.MAV_MISSION_ACCEPTED), (Mode.MANUAL, {}, dialect.MAV_MISSION_DENIED),
        (Mode.GUIDED, {"command": 20}, dialect.MAV_MISSION_UNSUPPORTED),
        (Mode.GUIDED, {"x": NAN}, dialect.MAV_MISSION_INVALID),
        (Mode.GUIDED, {"x": 80.0}, dialect.MAV_MISSION_INVALID_PARAM5_X),
        (Mode.GUIDED, {"frame": 1}, dialect.MAV_MISSION_ERROR),
    ],
)  # fmt: skip
def test_an_item_to_go_to_is_acknowledged(mode: Mode, fields: dict[str, Any], result: int) -> None:
    bench, item = Bench(), _item(2, -4.0)
    bench.arm(mode)
    for name, value in fields.items():
        setattr(item, name, value)
    bench.partner.send(item)
    assert [ack.type for ack in bench.partner.take_messages("MISSION_ACK")] == [result]
    target = bench.core.pilot.target
    assert (target is None) == (result != 0)
    assert target is None or target.heading is None, "a yaw of 0 is none"
