"""What a real QGroundControl asks for and does, recorded from outside, against the gateway's vehicle."""

from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common.schema import preset_folder
from hil.gateways.mavlink import assembly
from hil.gateways.mavlink.assembly import defaults_of, motors_of
from hil.gateways.mavlink.parameter_table import GATEWAY, INT8, INT16, INT32, REAL32, expand
from hil.gateways.mavlink.snapshot import ThrusterTest
from hil.scenario.config import load_scenario
from hil.scenario.mavlink_records import Mavlink
from sim.vehicle.vehicle import load_vehicle
from tests.support.clients.mavlink_missions import ACCEPTED, DENIED, UNSUPPORTED
from tests.support.clients.mavlink_vehicle import Bench


def _command(command: int, *params: float) -> Any:
    return dialect.MAVLink_command_long_message(1, 1, command, 0, *params, *[0.0] * (7 - len(params)))


def _parameter(name: str, value: float, kind: int) -> Any:
    return dialect.MAVLink_param_set_message(1, 1, name.encode(), value, kind)


# Requests as they were recorded, in their order: the message, and kind and fields of the answer to it.
VERSION = {"flight_sw_version": 0x04060000, "vendor_id": 0}
RECORDED: list[tuple[Any, str, dict[str, Any]]] = [
    (_command(512, 148), "AUTOPILOT_VERSION", VERSION),
    (_command(512, 397), "COMMAND_ACK", {"result": UNSUPPORTED}),  # it goes on without component information
    (_command(512, 395), "COMMAND_ACK", {"result": UNSUPPORTED}),
    *[(dialect.MAVLink_mission_request_list_message(1, 1, kind), "MISSION_COUNT", {"count": count})
      for kind, count in ((0, 1), (1, 0), (2, 0))],
    (dialect.MAVLink_mission_request_int_message(1, 1, 0, 0), "MISSION_ITEM_INT", {"command": 16, "seq": 0}),
    (_parameter("PILOT_SPEED", 70.0, INT16), "PARAM_VALUE", {"param_value": 70.0, "param_type": INT16}),
    (_parameter("PILOT_SPEED", 9999.0, INT16), "PARAM_VALUE", {"param_value": 70.0}),
    (dialect.MAVLink_param_request_read_message(1, 1, b"COMPASS_OFS_X", -1), "PARAM_VALUE", {"param_type": REAL32}),
    (_command(176, 1, 2), "COMMAND_ACK", {"result": ACCEPTED}),
    (_command(400, 1), "COMMAND_ACK", {"result": ACCEPTED}),
    (_command(176, 1, 4), "COMMAND_ACK", {"result": ACCEPTED}),
    (dialect.MAVLink_mission_count_message(1, 1, 0, 1), "MISSION_ACK", {"type": 0, "mission_type": 1}),
    (_command(400, 0, 21196), "COMMAND_ACK", {"result": ACCEPTED}),
    (_command(400, 1), "COMMAND_ACK", {"result": ACCEPTED}),
    (_command(400, 0, 21196), "COMMAND_ACK", {"result": ACCEPTED}),
    (dialect.MAVLink_log_request_list_message(1, 1, 0, 49), "LOG_ENTRY", {"num_logs": 0}),
    (dialect.MAVLink_serial_control_message(10, 22, 0, 0, 5, [0] * 70), "STATUSTEXT", {"severity": 4}),
    (_command(241, 0, 0, 1), "COMMAND_ACK", {"result": ACCEPTED}),
]  # fmt: skip
PREARM_CHECK = dialect.MAV_SYS_STATUS_PREARM_CHECK

# Parameters without which QGroundControl shows "Parameters are missing from firmware", at connection and on its pages.
NEEDED = (
    "COMPASS_DEV_ID{,2,3} COMPASS_OFS{,2,3}_{X,Y,Z} COMPASS_DEC INS_ACCOFFS_{X,Y,Z} FLTMODE{1..6} BATT_MONITOR "
    "FS_{PRESS,TEMP}_{ENABLE,MAX} FS_EKF_{ACTION,THRESH} ARMING_CHECK LEAK1_{PIN,LOGIC} SERVO{5..16}_FUNCTION "
    "FS_PILOT_{INPUT,TIMEOUT} FRAME_CONFIG COMPASS_USE{,2,3} COMPASS_CAL_FIT AHRS_ORIENTATION MOT_{1..6}_DIRECTION "
    "ATC_ANG_{PIT,RLL,YAW}_P ATC_RAT_{PIT,RLL,YAW}_{P,I,D,IMAX} LOIT_{ACC_MAX,ANG_MAX,SPEED} "
    "LOIT_BRK_{ACCEL,DELAY,JERK} WPNAV_{ACCEL,ACCEL_Z,RADIUS,SPEED,SPEED_DN,SPEED_UP} "
    "PSC_ACCZ_{P,I,D,IMAX,FLTD,FLTE,FLTT} PSC_POS{XY,Z}_P PSC_VELXY_{P,I,IMAX} PSC_VELZ_P JS_LIGHTS_STEPS BRD_PWM_COUNT"
)


def test_recorded_requests_get_the_answers_that_it_waits_for() -> None:
    bench = Bench()
    for request, kind, expected in RECORDED:
        bench.partner.received.clear()
        bench.partner.send(request)
        bench.run(0.1)
        answers = bench.partner.take_messages(kind)
        found = [{key: getattr(answer, key) for key in expected} for answer in answers]
        assert expected in found, (request.to_dict(), [answer.to_dict() for answer in answers])


def test_every_parameter_that_it_needs_is_there_as_ardusub_has_it() -> None:
    needed = {name for text in NEEDED.split() for name in expand(text)}
    assert len(needed) == 100
    assert not needed - set(GATEWAY)
    types = {"PILOT_SPEED_UP": INT16, "FRAME_CONFIG": INT8, "ARMING_CHECK": INT32, "BTN0_FUNCTION": INT8}
    assert {name: GATEWAY[name].kind for name in types} == types
    units = {"PILOT_SPEED_UP": "cm/s", "SURFACE_DEPTH": "cm", "WPNAV_RADIUS": "cm", "FS_PRESS_MAX": "Pa"}
    assert {name: GATEWAY[name].unit for name in units} == units
    assert all(one.least <= one.default <= one.most for one in GATEWAY.values())
    assert all(GATEWAY[name].default for name in expand("COMPASS_OFS_{X,Y,Z}")), "else it says that setup is required"


def test_frame_motors_and_system_id_follow_from_the_scenario(tmp_path: Path) -> None:
    scenario = load_scenario("ardusub")
    assert defaults_of(scenario)["FRAME_CONFIG"] == 2.0, "vectored 6DOF, eight thrusters"
    assert len(motors_of(scenario)) == 8
    assert (defaults_of(None), motors_of(None), assembly.origin_of(None)) == ({}, [], None)
    own = tmp_path / "own.toml"
    installed = Path(preset_folder("sim/vehicles"), "bluerov2_heavy_t200.toml").read_text(encoding="utf-8")
    own.write_text(installed.replace("# battery", "battery"), encoding="utf-8")
    assert defaults_of(scenario._replace(vehicle=str(own)))["BATT_CAPACITY"] == 18_219.0, "mAh: 266 Wh at 14.6 V"
    assert defaults_of(load_scenario("paper_field"))["SERVO7_FUNCTION"] == 0.0, "six thrusters"
    assert defaults_of(scenario)["SYSID_THISMAV"] == 2.0, "ArduSub is 1"
    assert defaults_of(scenario._replace(controller="builtin"))["SYSID_THISMAV"] == 1.0
    assert defaults_of(scenario)["BATT_MONITOR"] == 0.0
    assert defaults_of(scenario._replace(vehicle=str(own)))["BATT_MONITOR"] == 4.0


def test_full_sticks_are_four_fifths_of_what_the_thrusters_do_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the weaker direction of each; three thrusters ahead, to port and down, 0.5 m from the middle."""
    vehicle, table = load_vehicle("bluerov2_heavy_t200")
    rows = [((0.0, 0.5, 0.0), (1.0, 0.0, 0.0), 50.0, 40.07), ((0.5, 0.0, 0.0), (0.0, -1.0, 0.0), 20.0, 30.0),
            ((0.0, 0.5, 0.0), (0.0, 0.0, 1.0), 60.0, 60.0)]  # fmt: skip
    thrusters = tuple(
        vehicle.thrusters[0]._replace(position=at, direction=to, max_forward=ahead, max_reverse=astern)
        for at, to, ahead, astern in rows
    )
    monkeypatch.setattr(assembly, "load_vehicle", lambda _: (vehicle._replace(thrusters=thrusters), table))
    defaults = defaults_of(load_scenario("ardusub"))
    assert {name: value for name, value in defaults.items() if name[:7] in ("HIL_FOR", "HIL_MOM", "HIL_THR")} == {
        "HIL_THRUST": 20.0, "HIL_FORCE_X": 32.1, "HIL_FORCE_Y": 16.0, "HIL_FORCE_Z": 48.0,
        "HIL_MOMENT_K": 24.0, "HIL_MOMENT_M": 0.0, "HIL_MOMENT_N": 24.0,
    }  # fmt: skip
    assert [name for name in defaults if name.startswith("SERVO")] == [f"SERVO{n}_FUNCTION" for n in range(4, 9)]


def test_a_parameter_takes_effect_or_says_that_it_does_not() -> None:
    bench = Bench()
    assert bench.partner.set_parameter("ATC_RAT_YAW_P", 0.25) == 0.25
    assert "changes nothing" in bench.partner.texts()
    assert bench.partner.set_parameter("FRAME_CONFIG", 1.0) == 7.0
    assert "vehicle's file" in bench.partner.texts()
    bench.vehicle.values["ATC_ANG_YAW_P"] = 1.0
    assert bench.partner.set_parameter("ATC_ANG_YAW_P", 3.0) == 3.0
    assert bench.vehicle.values["ATC_ANG_YAW_P"] == 3.0, "the slave's gain"


def test_it_takes_the_vehicle_for_one_that_can_be_armed() -> None:
    """It never sends 400 to a vehicle that is "in air", and takes one without a version for an old ArduSub."""
    bench = Bench()
    bench.run(3.0)
    assert not bench.partner.take_messages("EXTENDED_SYS_STATE")
    request = dialect.MAV_CMD_REQUEST_MESSAGE
    assert bench.partner.command(request, dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE) == ACCEPTED
    assert bench.partner.take_messages("EXTENDED_SYS_STATE")[0].landed_state == dialect.MAV_LANDED_STATE_UNDEFINED
    assert bench.partner.command(request, dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION) == ACCEPTED
    assert bench.partner.take_messages("AUTOPILOT_VERSION")[0].flight_sw_version >> 8 == 0x040600


def test_readiness_and_its_reason_agree_with_the_answer_to_arming() -> None:
    bench = Bench()

    def health() -> bool:
        bench.run(1.0)
        return bool(bench.partner.take_messages("SYS_STATUS")[-1].onboard_control_sensors_health & PREARM_CHECK)

    bench.vehicle.refused, bench.vehicle.is_disarmed = "uuv1 is disarmed", True
    assert health(), "arming arms the slave, too"
    assert "PreArm" not in bench.partner.texts()
    bench.vehicle.refused, bench.vehicle.is_disarmed = "uuv1 is flown by ArduSub", False
    assert not health()
    assert "PreArm: uuv1 is flown by ArduSub" in bench.partner.texts().replace(" | ", "")
    bench.run(10.0)
    assert "PreArm" not in bench.partner.texts()
    assert bench.partner.command(dialect.MAV_CMD_RUN_PREARM_CHECKS) == ACCEPTED
    bench.run(0.1)
    assert "PreArm" in bench.partner.texts()


def test_modes_that_it_offers_and_this_vehicle_lacks_are_refused_by_name() -> None:
    bench = Bench()
    for number, name in ((1, "Acro"), (7, "Circle"), (21, "Surftrak"), (99, "mode 99")):
        assert bench.partner.command(dialect.MAV_CMD_DO_SET_MODE, 1, number) == DENIED
        bench.run(0.1)
        assert f"{name} is not a mode of this vehicle" in bench.partner.texts().replace(" | ", "")
    for params in ((1, float("nan")), (1, 1e30), (0, 2)):
        assert bench.partner.command(dialect.MAV_CMD_DO_SET_MODE, *params) == DENIED


def test_motors_page_turns_the_motor_of_its_slider_while_it_moves() -> None:
    bench = Bench(motors=[(3, -1), (0, 1)])
    percent = dialect.MAV_CMD_DO_MOTOR_TEST, 0, dialect.MOTOR_TEST_THROTTLE_PERCENT, 75.0, 0, 0
    assert bench.partner.command(*percent, dialect.MOTOR_TEST_ORDER_BOARD) == dialect.MAV_RESULT_FAILED
    bench.arm()
    bench.run(0.1)
    assert "Arm motors before testing motors." in bench.partner.texts()
    assert bench.partner.command(*percent, dialect.MOTOR_TEST_ORDER_BOARD) == ACCEPTED
    bench.run(0.3)
    assert bench.vehicle.commands[-1] == ThrusterTest(3, -0.5 * bench.table["HIL_THRUST"]), "of the frame, mirrored"
    assert bench.partner.command(dialect.MAV_CMD_DO_MOTOR_TEST, 7, *percent[2:], 2) == dialect.MAV_RESULT_FAILED
    bench.run(0.3)
    assert not bench.core.pilot.armed
    assert "Motor test timed out!" in bench.partner.texts()


@pytest.mark.parametrize(
    ("command", "params", "text", "kind"),
    [
        (241, (0, 0, 1), "barometer: calibrated", ""),
        (241, (1,), "gyroscope: calibrated", ""),
        (241, (0, 0, 0, 0, 2), "level: calibrated", ""),
        (241, (0, 0, 0, 0, 4), "accelerometer: calibrated", ""),
        (241, (0, 0, 0, 0, 1), "accelerometer: calibrated", "COMMAND_LONG"),
        (dialect.MAV_CMD_DO_CANCEL_MAG_CAL, (), "", ""),
        (dialect.MAV_CMD_DO_START_MAG_CAL, (1,), "compass: calibrated", "MAG_CAL_REPORT"),
    ],
)
def test_calibrations_are_answered_as_done(command: int, params: tuple[float, ...], text: str, kind: str) -> None:
    bench = Bench()
    assert bench.partner.command(command, *params) == ACCEPTED
    bench.run(0.1)
    assert text in bench.partner.texts()
    assert not kind or bench.partner.take_messages(kind)
    bench.arm()
    assert bench.partner.command(command, *params) == dialect.MAV_RESULT_FAILED


def test_requests_of_mavlink_1_are_answered_in_mavlink_1() -> None:
    """QGroundControl changes to it if PROTOCOL_VERSION is refused."""
    bench = Bench(Mavlink(autopilot="generic"))
    assert bench.partner.command(dialect.MAV_CMD_REQUEST_MESSAGE, 300) == ACCEPTED
    old = dialect.MAVLink(None, 255, 190)
    packet = dialect.MAVLink_param_request_list_message(1, 1).pack(old, force_mavlink1=True)
    bench.partner.packets.clear()
    bench.partner.feed(packet[:4])
    bench.partner.feed(packet[4:] + b"noise" + packet)
    bench.run(3.0)
    assert {sent[0] for sent in bench.partner.packets} == {0xFE}
    kinds = [sent[5] for sent in bench.partner.packets]
    assert kinds.count(dialect.MAVLINK_MSG_ID_PARAM_VALUE) == 2 * len(bench.table.names())
    assert dialect.MAVLINK_MSG_ID_HEARTBEAT in kinds
    bench.partner.packets.clear()
    bench.partner.heartbeat()
    bench.run(1.0)
    assert {sent[0] for sent in bench.partner.packets} == {0xFD}
