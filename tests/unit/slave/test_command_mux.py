"""Commands of every kind, from the bytes of their messages to the motion of the vehicle, without network and clock."""

import subprocess
import sys
from collections.abc import Iterator
from math import inf, nan, pi

import pytest

from hil.autonomy.control.controller import VelocityCommand, heading_of, wrap
from hil.common.clock import NS_PER_S
from hil.ros.commands import DECODERS, PoseCommand, encode_number, encode_pose, encode_thrusts
from hil.ros.frames import encode_wrench
from hil.ros.message import decode
from hil.ros.topics import COMMANDS
from hil.slave.command_mux import CommandMux
from hil.slave.setpoints import PoseSetpoint
from sim.sensors.samples import OdometrySample
from tests.support.flights.flying import GID, VEHICLE, Bench, twist

OTHER = b"b" * 16


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.command_receiver.close()


def heading(truth: OdometrySample) -> float:
    return heading_of(truth.orientation)


def test_a_depth_command_dives_at_the_present_position(bench: Bench) -> None:
    truth = bench.fly(8.0, cmd_depth=encode_number(3.0))
    assert truth.position[2] == pytest.approx(3.0, abs=0.1)
    assert truth.position[:2] == pytest.approx((4.0, 4.0), abs=0.2)


def test_the_vehicle_turns_to_a_heading_the_short_way(bench: Bench) -> None:
    assert heading(bench.fly(8.0, cmd_heading=encode_number(-2.5))) == pytest.approx(-2.5, abs=0.1)
    truth = bench.fly(5.0, cmd_heading=encode_number(2.5))
    assert wrap(heading(truth) - 2.5) == pytest.approx(0.0, abs=0.1)


def test_velocity_depth_and_heading_commands_combine(bench: Bench) -> None:
    messages = {"cmd_depth": encode_number(2.5), "cmd_heading": encode_number(1.0), "cmd_vel": twist(surge=0.3)}
    truth = bench.fly(8.0, **messages)
    assert truth.nu[0] == pytest.approx(0.3, abs=0.05)
    assert truth.position[2] == pytest.approx(2.5, abs=0.1)
    assert heading(truth) == pytest.approx(1.0, abs=0.1)


def test_commanded_heave_and_yaw_rate_override_holds(bench: Bench) -> None:
    messages = {"cmd_depth": encode_number(2.0), "cmd_heading": encode_number(0.0)}
    bench.fly(1.0, **messages)
    truth = bench.fly(3.0, **messages, cmd_vel=twist(heave=0.2, yaw_rate=0.3))
    assert truth.nu[2] == pytest.approx(0.2, abs=0.05)
    assert truth.nu[5] == pytest.approx(0.3, abs=0.05)


def test_a_pose_is_reached_and_held(bench: Bench) -> None:
    pose = encode_pose(PoseCommand((6.0, 5.0, 2.6), 1.2), 0, "uuv1/odom")
    truth = bench.fly(14.0, cmd_pose=pose)
    assert bench.pilot.position == pytest.approx((6.0, 5.0, 2.6), abs=0.1), "as far as it knows"
    assert truth.position == pytest.approx((6.0, 5.0, 2.6), abs=0.4)
    assert heading(truth) == pytest.approx(1.2, abs=0.1)
    truth = bench.fly(4.0, cmd_pose=pose)
    assert bench.pilot.position == pytest.approx((6.0, 5.0, 2.6), abs=0.1)
    assert max(map(abs, truth.nu[:3])) < 0.05


def test_a_wrench_is_allocated_to_the_thrusters(bench: Bench) -> None:
    bench.fly(0.5, cmd_wrench=encode_wrench(0, (20.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
    forces = bench.simulation.forces().thrusters
    assert forces[0] == pytest.approx(20.0, rel=0.05)
    assert max(map(abs, (forces[1], forces[2], forces[5]))) < 0.5
    bench.fly(1.0, cmd_wrench=encode_wrench(0, (0.0, 0.0, 0.0, 0.0, 0.0, 5.0)))
    assert bench.simulation.forces().thrusters[5] == pytest.approx(5.0, rel=0.1)


def test_each_thruster_gets_its_commanded_thrust(bench: Bench) -> None:
    bench.fly(0.5, cmd_thrusters=encode_thrusts((5.0, -5.0, 0.0, 0.0, 1e5, 0.0)))
    limits = VEHICLE.thrusters[4]
    assert bench.pulses[0] > 1500 > bench.pulses[1]
    assert bench.pulses[2] == bench.pulses[3] == bench.pulses[5] == 1500
    assert bench.pulses[4] == limits.pwm_max_us, "what is too much is as much as there is"


def test_the_deadman_ends_every_kind_of_command(bench: Bench) -> None:
    kinds = {
        "cmd_depth": encode_number(4.0),
        "cmd_pose": encode_pose(PoseCommand((9.0, 9.0, 2.0), 0.0), 0),
        "cmd_wrench": encode_wrench(0, (30.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
        "cmd_thrusters": encode_thrusts((9.0,) * 6),
    }
    for trips, (topic, payload) in enumerate(kinds.items(), 1):
        bench.fly(0.3, **{topic: payload})
        assert bench.pulses != (1500,) * 6
        bench.fly(0.7)
        assert bench.pulses == (1500,) * 6
        assert bench.pilot.deadman_trips == trips


def test_the_controller_is_reset_after_an_open_loop_command(bench: Bench) -> None:
    """Integrals from before the open-loop command do not act after it."""
    bench.fly(3.0, cmd_vel=twist(surge=0.6))
    bench.fly(6.0, cmd_wrench=encode_wrench(0, (0.0,) * 6))
    truth = bench.fly(0.5, cmd_vel=twist())
    assert truth.nu[0] < 0.2


@pytest.mark.parametrize(
    ("topic", "payload"),
    [
        ("cmd_depth", encode_number(nan)),
        ("cmd_depth", encode_number(12_000.0)),
        ("cmd_heading", encode_number(inf)),
        ("cmd_heading", encode_number(1e9)),
        ("cmd_vel", twist(surge=1e4)),
        ("cmd_pose", encode_pose(PoseCommand((nan, 0.0, 0.0), 0.0), 0)),
        ("cmd_pose", encode_pose(PoseCommand((1e7, 0.0, 0.0), 0.0), 0)),
        ("cmd_pose", encode_pose(PoseCommand((1.0, 0.0, 0.0), 0.0), 0, "base_link")),
        ("cmd_pose", encode_pose(PoseCommand((1.0, 0.0, 0.0), nan), 0)),
        ("cmd_pose", encode_pose(PoseCommand((1.0, 0.0, 0.0), 0.0), 0)[:-32] + bytes(32)),  # no attitude
        ("cmd_wrench", encode_wrench(0, (nan, 0.0, 0.0, 0.0, 0.0, 0.0))),
        ("cmd_wrench", encode_wrench(0, (0.0, 0.0, 0.0, 0.0, 0.0, 1e7))),
        ("cmd_thrusters", encode_thrusts((1.0,) * 5)),
        ("cmd_thrusters", encode_thrusts((1.0,) * 7)),
        ("cmd_thrusters", encode_thrusts(())),
        ("cmd_thrusters", encode_thrusts((nan,) * 6)),
        ("cmd_nothing", encode_number(1.0)),
        ("imu", encode_number(1.0)),
        *[(topic, b"") for topic in COMMANDS],
        *[(topic, b"\0\1\0\0" + b"\xff" * 60) for topic in COMMANDS],
    ],
)
def test_an_invalid_command_is_counted_and_ignored(bench: Bench, topic: str, payload: bytes) -> None:
    bench.send(topic, payload)
    assert bench.command_receiver.malformed == 1
    assert bench.command_receiver.take_latest() is None
    assert bench.command_receiver.master == b""


def test_a_fault_is_that_of_the_last_command_that_was_rejected(bench: Bench) -> None:
    for topic, payload in (("cmd_thrusters", encode_thrusts((1.0,) * 5)), ("cmd_depth", encode_number(3.0))):
        bench.send(topic, payload)
        assert bench.command_receiver.fault == "cmd_thrusters: 5 thrusts for 6 thrusters"
    bench.command_receiver.fault = "a later one"
    bench.send("cmd_depth", encode_number(3.0))
    assert bench.command_receiver.fault == "a later one"


def test_a_pose_is_unchanged_by_conversion_to_enu_and_back() -> None:
    pose = PoseCommand((3.0, -4.0, 5.0), 2.2)
    back = DECODERS["cmd_pose"](encode_pose(pose, 123, "map"))
    assert back.position == pytest.approx(pose.position)
    assert back.heading == pytest.approx(2.2)
    east = encode_pose(PoseCommand((0.0, 1.0, 0.0), pi / 2), 0)
    message = decode("geometry_msgs/msg/PoseStamped", east)  # what ROS sees: x east, and no turn
    assert message is not None
    seen = message["pose"]
    assert (seen["position"]["x"], seen["position"]["y"]) == pytest.approx((1.0, 0.0))
    assert abs(seen["orientation"]["w"]) == pytest.approx(1.0)


def test_sequence_numbers_of_a_master_count_per_topic(bench: Bench) -> None:
    bench.command_receiver.ranks[GID] = bench.command_receiver.ranks[OTHER] = 0
    bench.send("cmd_vel", twist())
    bench.send("cmd_depth", encode_number(2.0))
    assert (bench.command_receiver.refused, bench.command_receiver.disordered) == (0, 0)
    bench.send("cmd_pose", encode_pose(PoseCommand((0.0, 0.0, 2.0), 0.0), 0), OTHER)
    assert bench.command_receiver.refused == 1, "another master, on whatever topic"


def test_anonymous_senders_share_a_vehicle_by_topic(bench: Bench) -> None:
    """Two ROS 2 publishers, one of velocities and one of depths, count as one master; two of velocities do not."""
    bench.send("cmd_depth", encode_number(3.0), OTHER)
    bench.send("cmd_vel", twist(surge=0.2))
    taken = bench.command_receiver.take_latest()
    assert taken is not None
    assert taken.command == VelocityCommand(surge=0.2, depth=3.0)
    bench.send("cmd_vel", twist(surge=0.9), OTHER)
    assert bench.command_receiver.refused == 1
    bench.send("cmd_depth", encode_number(2.0), GID)
    assert bench.command_receiver.refused == 2


def test_a_hold_of_the_previous_master_is_dropped(bench: Bench) -> None:
    bench.command_receiver.ranks.update({GID: 0, OTHER: 1})
    bench.send("cmd_depth", encode_number(3.0))
    bench.send("cmd_vel", twist(surge=0.2), OTHER)
    taken = bench.command_receiver.take_latest()
    assert taken is not None
    assert taken.command == VelocityCommand(surge=0.2)


def test_the_newest_kind_of_command_applies() -> None:
    mux = CommandMux(6, NS_PER_S)
    pose = PoseCommand((1.0, 2.0, 3.0), 0.5)
    assert mux.combine("cmd_depth", 4.0, 0) == VelocityCommand(depth=4.0)
    assert mux.combine("cmd_pose", pose, 1) == PoseSetpoint(pose)
    assert mux.combine("cmd_vel", VelocityCommand(surge=1.0), NS_PER_S) == VelocityCommand(surge=1.0, depth=4.0)
    assert mux.combine("cmd_vel", VelocityCommand(surge=1.0), NS_PER_S + 1) == VelocityCommand(surge=1.0)


def test_a_plain_start_loads_no_modules_of_other_commands() -> None:
    code = (
        "import sys; import hil.commands.slave, hil.slave.daemon; "
        "print([m for m in sys.modules if m in ('hil.slave.command_mux', 'hil.ros.commands', "
        "'hil.autonomy.control.position')])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "[]\n"
