"""Guards of the MAVLink vehicle: arming, modes, failsafes, sticks, rights and complaints, each at its limit."""

from math import cos, nan, sin
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autonomy.control.controller import VelocityCommand
from hil.client.samples import State
from hil.common.clock import NS_PER_S
from hil.gateways.mavlink.core import MAX_COMPLAINTS, Core
from hil.gateways.mavlink.flight.modes import Mode
from hil.gateways.mavlink.flight.targets import Target, TargetError, attitude_target, earth_position, global_target
from hil.gateways.mavlink.snapshot import NEUTRAL, Origin
from hil.scenario.mavlink_records import Mavlink
from sim.sensors.extra_samples import BatterySample, FixSample
from tests.support.clients.mavlink_vehicle import ORIGIN, Bench

ACCEPTED, REJECTED, DENIED, _, FAILED = range(5)
ARM, MODE = dialect.MAV_CMD_COMPONENT_ARM_DISARM, dialect.MAV_CMD_DO_SET_MODE


def count_text(bench: Bench, text: str) -> int:
    return bench.partner.texts().replace(" | ", "").count(text)


# --- arming


def test_two_who_arm_while_the_slave_refuses_are_both_answered_in_time() -> None:
    bench = Bench()
    bench.vehicle.refused, bench.vehicle.is_disarmed = "uuv1 is disarmed", True
    for _ in range(2):
        assert bench.partner.command(ARM, 1) is None
    assert bench.vehicle.armed_calls == [True] * 2
    bench.run(1.7)
    assert bench.partner.take_messages("COMMAND_ACK") == []
    bench.run(0.2)
    assert [ack.result for ack in bench.partner.take_messages("COMMAND_ACK")] == [FAILED] * 2
    assert count_text(bench, "Arm: uuv1 is disarmed") == 2
    bench.vehicle.refused = ""
    bench.run(0.2)
    assert not bench.core.pilot.armed, "what has failed is over"
    assert [bench.partner.command(ARM, how) for how in (0.5, nan, 1, 1)] == [DENIED, DENIED, ACCEPTED, ACCEPTED]
    bench.run(0.1)
    assert count_text(bench, "Armed, mode Manual") == 1


def test_an_absent_vehicle_cannot_be_armed_and_a_lost_one_is_disarmed() -> None:
    bench = Bench()
    bench.core.set_mode(Mode.GUIDED)
    bench.vehicle.is_present = False
    bench.run(0.1)
    for command in (ARM, dialect.MAV_CMD_DO_SET_HOME, dialect.MAV_CMD_DO_REPOSITION, dialect.MAV_CMD_CONDITION_YAW):
        assert bench.partner.command(command, 1, 1) == REJECTED
    bench.partner.send(dialect.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0b110111111000, *[1.0] * 11))
    modes = [(mode, bench.partner.command(MODE, 1, mode)) for mode in Mode]
    assert [mode for mode, result in modes if result == ACCEPTED] == [Mode.STABILIZE, Mode.MANUAL]
    bench.vehicle.is_present = True
    bench.run(0.1)
    bench.arm()
    bench.vehicle.is_present = False
    sent = len(bench.vehicle.commands)
    bench.run(2.9)
    assert bench.core.pilot.armed
    bench.run(0.2)
    assert not bench.core.pilot.armed
    bench.partner.received.clear()
    bench.run(2.0)
    assert bench.partner.take_messages("HEARTBEAT") == []
    assert len(bench.vehicle.commands) == sent, "nothing is sent to a vehicle that is not there"
    bench.vehicle.is_present = True
    bench.run(1.0)
    assert bench.vehicle.commands[sent:] == [NEUTRAL] * 2, "it is stopped once it is back"


def test_a_second_arming_changes_nothing_and_a_new_one_forgets_what_was_before() -> None:
    bench = Bench()
    bench.arm(Mode.GUIDED)
    target = Target((30.0, 0.0, 4.0))
    assert bench.core.pilot.set_target(target, bench.now) == ""
    assert bench.partner.command(ARM, 1) == ACCEPTED
    bench.run(2.0)
    assert bench.core.pilot.target == target
    assert bench.partner.command(ARM, 0) == ACCEPTED
    bench.run(0.5)
    there = bench.vehicle.north
    assert bench.partner.command(ARM, 1) == ACCEPTED
    bench.run(1.0)
    assert bench.vehicle.north == pytest.approx(there, abs=0.2), "it holds where it is"
    bench.core.disarm()
    bench.vehicle.north = 99.0
    bench.core.pilot.arm()
    bench.run(1.0)
    assert bench.vehicle.north == pytest.approx(99.0, abs=0.2), "and not where it was armed before"


@pytest.mark.parametrize(("again_s", "armed"), [(0.4, True), (0.6, False)])
def test_a_motor_test_ends_half_a_second_after_the_last_one(again_s: float, armed: bool) -> None:
    bench = Bench()
    bench.arm()
    for _ in range(3):
        if bench.core.pilot.armed:
            bench.core.test_motor(1, 0.5, bench.now)
        bench.run(again_s)
    assert bench.core.pilot.armed == armed
    bench.run(1.0)
    assert bench.vehicle.commands[-1] == NEUTRAL
    bench.arm()
    bench.run(1.0)
    assert bench.core.pilot.armed, "it does not go on"
    assert [bench.core.test_motor(number, 0.5, bench.now) for number in (-1, 5, 6, 0.5)] == [False, True, False, False]


# --- modes and targets


def test_a_mode_begins_without_the_target_and_the_holds_of_the_one_before() -> None:
    bench = Bench()
    bench.arm(Mode.GUIDED)
    bench.core.pilot.set_target(Target((30.0, 0.0, 4.0)), bench.now)
    bench.run(1.0)
    for mode in (Mode.POSHOLD, Mode.GUIDED):
        assert bench.partner.command(MODE, 1, mode) == ACCEPTED
        there = bench.vehicle.north
        bench.run(2.0, bench.partner.sticks)
        assert bench.vehicle.north == pytest.approx(there, abs=0.3)
        bench.vehicle.north += 3.0
        bench.run(0.02)
    bench.core.set_mode(Mode.ALT_HOLD)
    bench.vehicle.depth = 6.0
    bench.run(0.02)
    bench.core.set_mode(Mode.MANUAL)
    bench.core.set_mode(Mode.ALT_HOLD)
    bench.run(2.0, bench.partner.sticks)
    assert bench.vehicle.depth == pytest.approx(6.0, abs=0.2), "it holds the depth of now"
    bench.core.set_mode(Mode.SURFACE)
    begun = bench.vehicle.heading
    bench.vehicle.heading, bench.vehicle.depth = begun + 0.3, 0.5
    bench.run(3.0)
    assert bench.vehicle.depth == pytest.approx(-bench.table["SURFACE_DEPTH"], abs=0.05)
    assert bench.vehicle.heading == pytest.approx(begun, abs=0.1), "the heading is that at the change of the mode"


HOLD, PLACE = Target((1.0, 0.0, 4.0), None, None, is_hold=True), Target((1.0, 0.0, 4.0))


@pytest.mark.parametrize(
    ("mode", "target", "refused"),
    [
        (Mode.MANUAL, HOLD, "follows none"), (Mode.SURFACE, HOLD, "follows none"), (Mode.GUIDED, PLACE, ""),
        (Mode.ALT_HOLD, PLACE, "alone"), (Mode.POSHOLD, PLACE, "alone"), (Mode.STABILIZE, HOLD, "holds no depth"),
        (Mode.STABILIZE, Target(None, (0.0,) * 3, 0.5, is_hold=True), ""), (Mode.POSHOLD, HOLD, ""),
    ],
)  # fmt: skip
def test_a_mode_takes_the_targets_that_it_can_follow(mode: Mode, target: Target, refused: str) -> None:
    bench = Bench()
    bench.core.set_mode(mode)
    assert "arm first" in bench.core.pilot.set_target(target, bench.now)
    bench.arm(mode)
    found = bench.core.pilot.set_target(target, bench.now)
    assert refused in found
    assert bool(found) == bool(refused)
    if not refused and mode != Mode.GUIDED:
        holds = bench.core.pilot._holds
        assert (holds.depth, holds.heading)[target.heading is not None] == (target.heading or 4.0)


@pytest.mark.parametrize(
    ("velocity", "yaw_rate", "heading", "depth", "expected"),
    [
        ((0.3, 0.0, 0.2), 0.0, None, 2.0, VelocityCommand(0.3, 0.0, 0.2, 0.0, None, 0.5)),
        ((0.3, 0.0, 0.2), 0.0, None, 9.0, VelocityCommand(0.3, 0.0, 0.0, 0.0, 9.0, 0.5)),  # HIL_DEPTH_MAX
        ((0.3, 0.0, -0.2), 0.0, None, 9.5, VelocityCommand(0.3, 0.0, -0.2, 0.0, None, 0.5)),
        ((0.3, 0.1, 0.0), 0.2, None, 3.0, VelocityCommand(0.3, 0.1, 0.0, 0.2, 3.0, None)),
        ((0.3, 0.1, 0.0), 0.2, 1.5, 3.0, VelocityCommand(0.3, 0.1, 0.0, 0.2, 3.0, 1.5)),
    ],
)
def test_a_velocity_target_holds_what_it_does_not_move(
    velocity: Any, yaw_rate: float, heading: float | None, depth: float, expected: VelocityCommand
) -> None:
    bench = Bench()
    bench.table.set("HIL_DEPTH_MAX", 9.0)
    bench.arm(Mode.GUIDED)
    bench.vehicle.heading, bench.vehicle.depth = 0.5, depth
    bench.core.pilot._holds.release()
    bench.core.pilot.set_target(Target(None, velocity, heading, yaw_rate), bench.now)
    snapshot = bench.vehicle.snapshot()
    found = bench.core.pilot.step(snapshot, bench.now)
    assert isinstance(found, VelocityCommand)
    assert [value or 0.0 for value in found] == pytest.approx([value or 0.0 for value in expected])
    assert (found.depth is None, found.heading is None) == (expected.depth is None, expected.heading is None)


@pytest.mark.parametrize(
    ("action", "armed", "texts"), [(0, True, 0), (1, True, 1), (2, False, 1)], ids=["nothing", "centred", "disarmed"]
)
def test_a_joystick_that_falls_silent_acts_once_as_configured(action: int, armed: bool, texts: int) -> None:
    bench = Bench()
    bench.table.set("FS_PILOT_INPUT", action)
    bench.arm()
    bench.run(2.0)
    assert (bench.core.pilot.armed, count_text(bench, "joystick silent")) == (True, 0), "there was none"
    bench.run(1.0, bench.partner.sticks)
    bench.run(4.0)
    assert (bench.core.pilot.armed, count_text(bench, "joystick silent")) == (armed, texts)
    if armed:
        bench.run(0.1, bench.partner.sticks)
        bench.run(4.0)
        assert count_text(bench, "joystick silent") == texts, "and once again the next time"
    bench.run(0.1, bench.partner.sticks)
    bench.core.disarm()
    bench.arm()
    bench.run(2.0)
    assert (bench.core.pilot.armed, count_text(bench, "joystick silent")) == (True, 0), "it was let go while disarmed"


# --- failsafes


@pytest.mark.parametrize(("action", "armed", "mode"), [(0, True, 19), (1, True, 19), (2, False, 19), (4, True, 9)])
def test_a_silent_ground_station_acts_as_configured(action: int, armed: bool, mode: int) -> None:
    bench = Bench()
    bench.table.set("FS_GCS_ENABLE", action)
    bench.arm()
    bench.run(2.0, bench.partner.heartbeat)
    bench.run(4.0)
    assert (bench.core.pilot.armed, bench.core.pilot.mode) == (armed, mode)


def test_a_silent_ground_station_acts_once_each_time() -> None:
    bench = Bench()
    bench.table.set("FS_GCS_ENABLE", 3)
    limit_s = bench.table["FS_GCS_TIMEOUT"]
    bench.arm()
    for _ in range(2):
        bench.run(0.2, bench.partner.heartbeat)
        bench.core.set_mode(Mode.MANUAL)
        bench.run(limit_s - 0.1)
        assert bench.core.pilot.mode == Mode.MANUAL
        bench.run(0.2)
        assert (bench.core.pilot.mode, count_text(bench, "no ground station")) == (Mode.ALT_HOLD, 1)
        bench.core.set_mode(Mode.MANUAL)
        bench.run(limit_s + 1.0)
        assert (bench.core.pilot.mode, count_text(bench, "no ground station")) == (Mode.MANUAL, 0)
    for kind, back in ((dialect.MAV_TYPE_SUBMARINE, 0), (dialect.MAV_TYPE_GCS, 1), (dialect.MAV_TYPE_GCS, 0)):
        bench.partner.send(dialect.MAVLink_heartbeat_message(kind, 8, 0, 0, 0, 3))
        bench.run(0.1)
        assert count_text(bench, "ground station is back") == back


@pytest.mark.parametrize(
    ("action", "pin", "mode", "texts"),
    [(0, 27, Mode.MANUAL, 0), (1, 27, Mode.MANUAL, 1), (2, -1, Mode.MANUAL, 0), (2, 27, Mode.SURFACE, 1)],
)
def test_a_leak_is_reported_once_where_there_is_a_sensor(action: int, pin: int, mode: Mode, texts: int) -> None:
    bench = Bench()
    bench.table.set("FS_LEAK_ENABLE", action)
    bench.table.set("LEAK1_PIN", pin)
    bench.arm()
    for _ in range(2):
        bench.vehicle.leak = True
        bench.run(1.0)
        assert (bench.core.pilot.mode, count_text(bench, "Leak detected")) == (mode, texts)
        bench.vehicle.leak = False
        bench.run(0.1)


@pytest.mark.parametrize(
    ("monitor", "action", "armed", "mode", "texts"),
    [(4, 0, True, Mode.MANUAL, 1), (4, 2, False, Mode.MANUAL, 1), (4, 3, True, Mode.SURFACE, 1),
     (0, 2, True, Mode.MANUAL, 0)],
)  # fmt: skip
def test_an_empty_battery_acts_once_after_its_time(
    monitor: int, action: int, armed: bool, mode: Mode, texts: int
) -> None:
    bench = Bench()
    for name, value in (("BATT_CRT_VOLT", 14.0), ("BATT_LOW_TIMER", 2.0), ("BATT_FS_CRT_ACT", action)):
        bench.table.set(name, value)
    bench.table.set("BATT_MONITOR", monitor)
    bench.table.set("BATT_LOW_VOLT", 0.0)

    def run(volts: float, seconds: float) -> None:
        bench.vehicle.battery = BatterySample(0, volts, 2.0, 100.0, 50.0, False)
        bench.run(seconds)

    bench.arm()
    for volts, seconds in ((13.9, 1.8), (14.0, 0.1), (13.9, 1.8)):  # at the limit it has recovered
        run(volts, seconds)
    assert (bench.core.pilot.armed, count_text(bench, "Battery critical")) == (True, 0)
    run(13.9, 9.0)
    assert (bench.core.pilot.armed, bench.core.pilot.mode) == (armed, mode)
    assert count_text(bench, "Battery critical") == texts
    run(15.0, 0.1)
    run(13.0, 3.0)
    assert count_text(bench, "Battery critical") == (texts if armed else 0), "after it has recovered"


def test_why_it_cannot_be_armed_is_said_again_after_half_a_minute_and_when_that_changes() -> None:
    bench = Bench()
    counts = []
    for reason, seconds in (("uuv1 is busy", 1.0), ("uuv1 is busy", 28.5), ("uuv1 is busy", 1.0), ("other", 0.1)):
        bench.vehicle.refused = reason
        bench.run(seconds)
        counts.append(count_text(bench, "PreArm: "))
    assert counts == [1, 0, 1, 1]
    bench.vehicle.refused = ""
    bench.run(0.1)
    bench.vehicle.refused = "other"
    bench.run(0.1)
    assert count_text(bench, "PreArm: other") == 1


def test_a_complaint_is_made_once_in_its_time_and_few_are_stored() -> None:
    bench = Bench()
    core, second = bench.core, NS_PER_S
    for at, every in ((0, 10), (9.9, 10), (10, 10), (19, 5), (19, 60)):
        core.complain("words", bench.now + round(at * second), every * second)
    assert [text for _, text in core.texts].count("words") == 3
    for number in range(3 * MAX_COMPLAINTS):
        core.complain(f"words {number}", bench.now)
    assert len(core._complaints) <= MAX_COMPLAINTS


# --- places


def test_home_is_where_it_was_first_seen_and_the_origin_is_set_once() -> None:
    bench = Bench(origin=None)
    assert bench.core.home == (0.0, 0.0, 0.0)
    bench.vehicle.north, bench.vehicle.east = 30.0, 40.0
    later = Core(bench.vehicle, Mavlink(), bench.table, None, 0)
    later.tick(1)
    assert later.home == (30.0, 40.0, 0.0)
    fix = FixSample(0, 45.0, 10.0, 7.0, (1.0, 1.0), False)
    snapshot = bench.vehicle.snapshot()
    assert snapshot
    for has_fix in (False, True, True):
        bench.core._find_places(snapshot._replace(fix=fix._replace(fix=has_fix, latitude=45.0 + has_fix)))
        assert (bench.core.origin is None) == (not has_fix)
    assert bench.core.origin
    place = earth_position(46.0e7, 10.0e7, 0.0, bench.core.origin)
    assert place == pytest.approx((30.0, 40.0, 0.0), abs=0.01)
    assert bench.core.origin.altitude == 7.0 + bench.vehicle.depth
    assert bench.core.home == (0.0, 0.0, 0.0)
    assert "not taken" in bench.core.set_origin(ORIGIN)
    near, other = (bench.core.origin._replace(altitude=bench.core.origin.altitude + off) for off in (5e-7, 5e-6))
    assert (bench.core.set_origin(near), "not taken" in bench.core.set_origin(other)) == ("", True)
    assert "no such place" in bench.core.set_origin(None)


@pytest.mark.parametrize(
    ("mask", "frame", "alt", "expected"),
    [
        (0b100111111000, dialect.MAV_FRAME_GLOBAL, -4.0, (0.0, 0.0, 104.0)),
        (0b110111111000, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, -4.0, (0.0, 0.0, 4.5)),
        (0b110111111011, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT, 9.0, (7.0, 8.0, 0.0)),
        (0b110111111100, 0, 5.0, (0.0, 0.0, 9.0)), (0b110111111000, 0, nan, None), (0b110111111000, 1, -4.0, None),
    ],
)  # fmt: skip
def test_a_global_target_replaces_what_it_does_not_ignore(
    mask: int, frame: int, alt: float, expected: tuple[float, ...] | None
) -> None:
    message = dialect.MAVLink_set_position_target_global_int_message(
        0, 1, 1, frame, mask, round(45e7), round(10e7), alt, 0, 0, 0, 0, 0, 0, 0.2, 0
    )
    state = State(0, (7.0, 8.0, 9.0), (cos(0.5), 0.0, 0.0, sin(0.5)), (0.0,) * 6)
    origin = Origin(45.0, 10.0, 100.0)
    if expected is None:
        with pytest.raises(TargetError):
            global_target(message, state, origin, 0.5)
        return
    found = global_target(message, state, origin, 0.5)
    assert found.position == pytest.approx(expected, abs=1e-6)
    assert (found.is_hold, found.heading) == (mask & 0b11 == 0b11, None if mask & 1 << 10 else 0.2)


@pytest.mark.parametrize(
    ("mask", "yaw_rate", "raises"),
    [(0, 0.3, False), (1 << 7, 20.0, False), (1 << 7, -20.1, True), (1 << 7, nan, True), (1 << 7 | 1 << 2, 0.0, True),
     (1 << 6, 0.3, False)],
)  # fmt: skip
def test_an_attitude_target_is_a_heading_or_a_turn_rate(mask: int, yaw_rate: float, raises: bool) -> None:
    q = [cos(0.25), 0.0, 0.0, sin(0.25)]
    packet = dialect.MAVLink_set_attitude_target_message(0, 1, 1, mask, q, 0.0, 0.0, yaw_rate, 1.0)
    if raises:
        with pytest.raises(TargetError):
            attitude_target(packet, 0.4)
        return
    found, by_rate = attitude_target(packet, 0.4), bool(mask & 1 << 7)
    assert found.heading == (None if by_rate else pytest.approx(0.5))
    assert (found.yaw_rate, found.is_hold) == (yaw_rate if by_rate else 0.0, not by_rate)
    assert found.velocity == (0.0, 0.0, 0.0 if mask & 1 << 6 else pytest.approx(-0.4))
