"""Modes of the MAVLink vehicle: what each commands, what it holds, and what stops it."""

from math import pi
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autonomy.control.controller import VelocityCommand
from hil.gateways.mavlink.flight.modes import Mode, base_mode
from hil.gateways.mavlink.flight.targets import Target, local_target
from hil.gateways.mavlink.snapshot import NEUTRAL
from hil.ros.commands import PoseCommand
from tests.support.clients.mavlink_vehicle import Bench, PointVehicle

ACCEPTED = dialect.MAV_RESULT_ACCEPTED
ARM = dialect.MAV_CMD_COMPONENT_ARM_DISARM
POSITION_ONLY, VELOCITY_ONLY = 0b110111111000, 0b110111000111


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


def test_the_pose_is_held_at_the_place_of_a_target_unless_the_vehicle_steers_by_fins() -> None:
    bench = Bench()
    bench.table.set("HIL_DEPTH_MAX", 2.0)
    bench.arm(Mode.GUIDED)
    bench.vehicle.heading = 0.5
    for east, heading, fins, expected in (
        (0.29, None, 0, 0.5),
        (0.29, 1.0, 0, 1.0),
        (0.31, 1.0, 0, 0),
        (0.2, 1.0, 1, 0),
    ):
        bench.table.set("HIL_STEER", fins)
        bench.core.pilot.set_target(Target((0.0, east, 2.05), None, heading), bench.now)
        found = bench.core.pilot.step(bench.vehicle.snapshot(), bench.now)
        assert found == PoseCommand((0.0, east, 2.0), expected) if expected else isinstance(found, VelocityCommand)


def test_a_depth_is_held_after_a_target_moved_it_and_a_heading_after_a_turn() -> None:
    bench = Bench()
    bench.arm(Mode.GUIDED)
    pilot = bench.core.pilot

    def fly(velocity: Any, yaw_rate: float) -> VelocityCommand:
        pilot.set_target(Target(None, velocity, None, yaw_rate), bench.now)
        bench.run(1.0)
        command = bench.vehicle.commands[-1]
        assert isinstance(command, VelocityCommand)
        return command

    fly((0.0, 0.0, 0.5), 0.3)
    held = fly((0.1, 0.0, 0.0), 0.0)
    assert (held.depth, held.heading) == pytest.approx((bench.vehicle.depth, bench.vehicle.heading), abs=0.02)


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


def test_flags_of_the_heartbeat_are_those_of_a_real_ardusub() -> None:
    recorded = {0: 209, 2: 209, 3: 217, 4: 217, 9: 209, 16: 217, 19: 209}
    assert {int(mode): base_mode(mode, True) for mode in Mode} == recorded
    assert base_mode(Mode.MANUAL, False) == 81


def test_local_targets_are_read_in_their_frames() -> None:
    vehicle = PointVehicle()
    vehicle.heading, vehicle.north = pi / 2, 10.0
    message = dialect.MAVLink_set_position_target_local_ned_message
    mask = POSITION_ONLY & ~(1 << 10)
    body = local_target(message(0, 1, 1, 9, mask, 2.0, 0, -1.0, 0, 0, 0, 0, 0, 0, 0.2, 0), vehicle.state)
    assert (*(body.position or ()), body.heading) == pytest.approx((10.0, 2.0, 1.0, pi / 2 + 0.2))
    world = local_target(message(0, 1, 1, 1, VELOCITY_ONLY, 0, 0, 0, 0.3, 0, 0, 0, 0, 0, 0, 0), vehicle.state)
    assert world.velocity == pytest.approx((0.0, -0.3, 0.0))
