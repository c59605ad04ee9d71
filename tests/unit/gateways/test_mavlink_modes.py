"""Modes of the MAVLink vehicle: what each commands, what it holds, and what stops it."""

from math import pi

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autonomy.control.controller import VelocityCommand
from hil.gateways.mavlink.flight.modes import Mode, base_mode
from hil.gateways.mavlink.flight.targets import local_target
from hil.gateways.mavlink.snapshot import NEUTRAL
from tests.support.clients.mavlink_vehicle import Bench, PointVehicle

ACCEPTED = dialect.MAV_RESULT_ACCEPTED
ARM = dialect.MAV_CMD_COMPONENT_ARM_DISARM
POSITION_ONLY, VELOCITY_ONLY = 0b110111111000, 0b110111000111


def test_stale_stick_messages_are_ignored() -> None:
    bench = Bench()
    bench.arm()
    bench.dispatcher.stale = True
    bench.run(0.5, lambda: bench.partner.sticks(x=1000))
    assert bench.vehicle.commands[-1] == NEUTRAL
    assert bench.core.pilot.joystick.stale == 25


def test_depth_hold_holds_the_depth_at_stick_release() -> None:
    bench = Bench()
    bench.arm(Mode.ALT_HOLD)
    bench.run(2.0, lambda: bench.partner.sticks(z=0))
    dived = bench.vehicle.depth
    assert dived > 2.4
    bench.run(3.0, bench.partner.sticks)
    assert abs(bench.vehicle.depth - dived) < 0.2
    held = bench.vehicle.commands[-1]
    assert isinstance(held, VelocityCommand)
    assert held.depth == pytest.approx(bench.vehicle.depth, abs=0.01)


def test_position_hold_returns_after_a_disturbance() -> None:
    bench = Bench()
    bench.arm(Mode.POSHOLD)
    bench.run(0.5, bench.partner.sticks)
    bench.vehicle.north += 2.0
    bench.run(15.0, bench.partner.sticks)
    assert abs(bench.vehicle.north) < 0.05


def test_a_velocity_target_expires() -> None:
    bench = Bench()
    bench.arm(Mode.GUIDED)
    bench.partner.send(
        dialect.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, dialect.MAV_FRAME_BODY_NED, VELOCITY_ONLY, 0, 0, 0, 0.4, 0, 0, 0, 0, 0, 0, 0
        )
    )
    bench.run(2.0)
    assert bench.vehicle.north == pytest.approx(0.8, abs=0.05)
    bench.run(10.0)
    assert bench.vehicle.north < 1.6
    assert "timed out" in bench.partner.texts()


def test_surface_mode_rises() -> None:
    bench = Bench()
    bench.vehicle.depth = 5.0
    bench.arm(Mode.SURFACE)
    bench.run(15.0)
    assert bench.vehicle.depth == pytest.approx(-bench.table["SURFACE_DEPTH"], abs=0.05)


def test_delayed_arming_is_acknowledged_once_the_slave_accepts() -> None:
    bench = Bench()
    bench.vehicle.refused = "uuv1 is disarmed"
    assert bench.partner.command(ARM, 1) is None
    bench.run(0.5)
    bench.vehicle.refused = ""
    bench.run(0.2)
    assert [ack.result for ack in bench.partner.take_messages("COMMAND_ACK")] == [ACCEPTED]
    assert bench.core.pilot.armed


def test_another_master_disarms() -> None:
    bench = Bench()
    bench.arm()
    bench.vehicle.refused = "uuv1 is commanded by another master"
    bench.run(0.5)
    assert not bench.core.pilot.armed
    assert "another master" in bench.partner.texts()


def test_disarming_sends_neutral_and_then_nothing() -> None:
    bench = Bench()
    bench.arm()
    bench.run(0.5, lambda: bench.partner.sticks(x=1000))
    assert bench.partner.command(ARM, 0) == ACCEPTED
    count = len(bench.vehicle.commands)
    bench.run(1.0, lambda: bench.partner.sticks(x=1000))
    assert 0 < len(bench.vehicle.commands) - count <= 3
    assert bench.vehicle.commands[-1] == NEUTRAL
    assert bench.partner.command(ARM, 0, 21196) == ACCEPTED


def test_without_a_ground_station_there_is_no_failsafe() -> None:
    bench = Bench()
    bench.arm()
    bench.run(10.0)
    assert bench.core.pilot.armed


def test_flags_of_the_heartbeat_are_those_of_a_real_ardusub() -> None:
    recorded = {0: 209, 2: 209, 3: 217, 4: 217, 9: 209, 16: 217, 19: 209}
    assert {int(mode): base_mode(mode, True) for mode in Mode} == recorded
    assert base_mode(Mode.MANUAL, False) == 81


def test_local_targets_are_read_in_their_frames() -> None:
    vehicle = PointVehicle()
    vehicle.heading, vehicle.north = pi / 2, 10.0
    message = dialect.MAVLink_set_position_target_local_ned_message
    body = local_target(message(0, 1, 1, 9, POSITION_ONLY, 2.0, 0, -1.0, 0, 0, 0, 0, 0, 0, 0, 0), vehicle.state)
    assert body.position == pytest.approx((10.0, 2.0, 1.0))
    world = local_target(message(0, 1, 1, 1, VELOCITY_ONLY, 0, 0, 0, 0.3, 0, 0, 0, 0, 0, 0, 0), vehicle.state)
    assert world.velocity == pytest.approx((0.0, -0.3, 0.0))
