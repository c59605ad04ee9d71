"""The Python interface `hil.connect` with a real slave: discovery, samples, commands, and their errors."""

import asyncio
import functools
import re
import signal
import time
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import pairwise
from math import nan
from pathlib import Path
from typing import Any

import pytest

import hil
from hil.autonomy.paths.trajectory import Limits
from hil.client.fleet import Fleet
from hil.client.samples import Imu, State
from hil.client.vehicle_handle import Vehicle
from hil.common.errors import ConfigError, MissionError, NetworkError
from hil.recording.reader import read_messages
from hil.ros.topics import COMMANDS, Topic
from tests.support.network.python_api import endpoint, fleet, own_slave, vehicle
from tests.support.processes import Program, free_port, run_here, slave_with, wait_for, write_scenario

__all__ = ["endpoint", "fleet", "own_slave", "vehicle"]  # the fixtures


def test_vehicles_are_discovered(fleet: Fleet) -> None:
    assert list(fleet.vehicles) == ["uuv1"] == fleet.names
    assert [vehicle.name for vehicle in fleet] == ["uuv1"]
    assert fleet["uuv1"] is fleet.vehicles["uuv1"]
    assert "uuv1" in repr(fleet)


def test_state_and_sensors_are_typed_and_have_an_age(vehicle: Vehicle) -> None:
    assert wait_for(lambda: 0.0 <= vehicle.imu.age < 0.2 and 0.0 <= vehicle.state.age < 0.2)
    state, imu = vehicle.state, vehicle.imu
    assert isinstance(state, State)
    assert isinstance(imu, Imu)
    first = imu.age
    time.sleep(0.05)
    assert imu.age > first + 0.049, "age goes on"
    assert state.depth == state.position[2] == pytest.approx(vehicle.ground_truth.depth, abs=0.3)
    assert imu.acceleration[2] == pytest.approx(-9.8, abs=1.0)
    assert vehicle.pressure.pascal == pytest.approx(101_325 + 9.8e3 * state.depth, rel=0.03)
    assert state.speed == pytest.approx(sum(v * v for v in state.velocity) ** 0.5)
    assert abs(state.roll) < 0.1
    assert abs(state.pitch) < 0.1
    assert vehicle.dvl.locked
    assert vehicle.altitude.distance > 0.0
    assert vehicle.altimeter.distance == pytest.approx(vehicle.altitude.distance, abs=0.3)
    assert not vehicle.leak
    assert vehicle.leak.on is False
    assert vehicle.diagnostics.thrusters == 6


def test_an_iterator_gives_every_sample(vehicle: Vehicle) -> None:
    stream = vehicle.samples("imu")
    samples = [sample for sample, _ in zip(stream, range(30), strict=False)]
    steps = [after.time_ns - before.time_ns for before, after in pairwise(samples)]
    assert set(steps) == {10_000_000}, "100 Hz, none left out, none twice"
    assert isinstance(samples[0], Imu)
    assert stream.dropped == 0
    short_stream = vehicle.samples("imu", depth=4)
    assert wait_for(lambda: short_stream.dropped > 5)
    before = vehicle.imu.time_ns
    assert next(short_stream).time_ns > before - 100_000_000, "the oldest were dropped"


def test_each_kind_of_command_moves_the_vehicle(vehicle: Vehicle) -> None:
    north, east, depth = vehicle.state.position
    vehicle.drive(surge=0.3, depth=depth + 0.2, heading=0.4)
    assert wait_for(lambda: vehicle.state.velocity[0] > 0.2 and vehicle.state.depth > depth + 0.1)
    vehicle.push(y=15.0)
    assert wait_for(lambda: vehicle.state.velocity[1] > 0.1)
    vehicle.thrust(-6.0, -6.0, -6.0, -6.0, 0.0, 0.0)
    assert wait_for(lambda: vehicle.state.velocity[0] < -0.1)
    assert vehicle.go_to(north, east, depth, heading=0.4).wait(60).done
    assert vehicle.state.position == pytest.approx((north, east, depth), abs=0.35)
    vehicle.stop()
    assert wait_for(lambda: vehicle.ground_truth.speed < 0.08)


@pytest.mark.parametrize("options", [{"smooth": True}, {"lookahead": 0.8}])
def test_paths_are_followed(vehicle: Vehicle, options: dict[str, Any]) -> None:
    north, east, depth = vehicle.state.position
    path = [(north, east + 0.5, depth), (north + 0.2, east + 1.0, depth)]
    brisk = Limits(acceleration=1.0, yaw_rate=2.0, lateral_acceleration=2.0)
    assert vehicle.follow(path[:1], 0.6, brisk, **options).wait(60).done
    assert vehicle.state.position == pytest.approx(path[0], abs=0.35)
    assert vehicle.hold_heading(0.0, tolerance=1.0).wait(60).done


def test_a_new_command_ends_the_previous_action(vehicle: Vehicle) -> None:
    north, east, depth = vehicle.state.position
    far_action = vehicle.go_to(north + 50.0, east, depth)
    with pytest.raises(MissionError, match=r"within 0\.1 s"):
        far_action.wait(0.1)
    vehicle.stop()
    with pytest.raises(MissionError, match="another command"):
        far_action.wait()


def test_the_interface_works_with_asyncio(endpoint: str) -> None:
    async def fly() -> tuple[list[int], bool, int]:
        async with hil.connect(endpoint, wait=60.0) as fleet:
            (vehicle,) = await fleet.find("uuv1", seconds=60)
            ticks = 0

            async def tick() -> None:
                nonlocal ticks
                while True:
                    await asyncio.sleep(0.01)
                    ticks += 1

            ticking = asyncio.create_task(tick())
            times = []
            async for sample in vehicle.samples("imu"):
                times.append(sample.time_ns)
                if len(times) == 20:
                    break
            reported = await vehicle.hold_depth(vehicle.state.depth + 0.3)
            ticking.cancel()
            return times, reported.done, ticks

    times, done, ticks = asyncio.run(fly())
    assert {after - before for before, after in pairwise(times)} == {10_000_000}
    assert done
    assert ticks > 40, "other work went on meanwhile"


@pytest.fixture(scope="module")
def silent(endpoint: str) -> Iterator[Vehicle]:
    """Provide a vehicle that is never commanded, to which each test would take seconds to connect."""
    with hil.connect(endpoint, wait=60.0) as fleet:
        yield fleet["uuv1"]


@pytest.mark.parametrize(
    ("wrong_call", "message"),
    [
        (lambda v: v.drive(surge=nan), "surge: nan is not between -20 and 20 m/s"),
        (lambda v: v.drive(surge=50.0), "surge: 50"),
        (lambda v: v.drive(heave=0.1, depth=2.0), "depth or heave"),
        (lambda v: v.hold_depth(1e5), "depth: 100000"),
        (lambda v: v.go_to(nan, 0.0, 1.0), "north: nan"),
        (lambda v: v.push(k=1e9), "k: 1e+09 is not between -1e+06 and 1e+06 N m"),
        (lambda v: v.thrust(1.0, 2.0), "has 6 thrusters, and 2 thrusts were given; give one for each"),
        (lambda v: v.thrust(nan, 0, 0, 0, 0, 0), "thruster 1: nan"),
        (lambda v: v.follow([(1.0, 2.0)]), "(north, east, depth)"),
        (lambda v: v.samples("imuu"), "did you mean 'imu'"),
        (lambda v: v.samples("thermometer"), "of your own is known once its scenario was read: hil.scenario.config"),
    ],
)
def test_wrong_arguments_are_reported(silent: Vehicle, wrong_call: Callable[[Vehicle], object], message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        wrong_call(silent)
    assert message in str(caught.value)
    assert not silent.client.has_commanded


def test_camera_topics_have_the_name_of_their_encoding(tmp_path: Path) -> None:
    """Pictures are JPEG unless the scenario says otherwise; an error names the kind that there is."""
    with (
        slave_with(tmp_path, "camera = { rate = 5, width = 64, height = 48 }") as endpoint,
        hil.connect(endpoint, wait=60.0) as fleet,
    ):
        vehicle = fleet["uuv1"]
        assert next(vehicle.samples("camera/image_raw/compressed", timeout=60.0))

        def is_reported(ask: Callable[[], object], reported: str) -> bool:
            """True if the error names what the vehicle sends; a query that gets no answer in time leaves that out."""
            with pytest.raises(NetworkError) as caught:
                ask()
            return bool(re.search(reported, str(caught.value)))

        named = r"imu.*its pictures are 'camera/image_raw/compressed', as \[ros\] images"
        assert wait_for(lambda: is_reported(lambda: next(vehicle.samples("camera/image_raw", timeout=0.5)), named))
        sent = r"it sends .*camera/image_raw/compressed.*\[sensors"
        assert wait_for(lambda: is_reported(lambda: vehicle.gps, sent))


def test_a_missing_slave_is_reported_with_the_remedy() -> None:
    start = time.monotonic()
    with hil.connect(f"tcp/127.0.0.1:{free_port()}", wait=0.3) as fleet:
        with pytest.raises(NetworkError, match=r"nothing listens on port.*uuv-hil slave"):
            _ = fleet.vehicles
        with pytest.raises(NetworkError, match=r"'uuv1'.*nothing listens"):
            fleet["uuv1"]
    assert time.monotonic() - start < 30, "it waits for as long as was requested, not for ever"
    with pytest.raises(NetworkError, match="tcp/HOST:PORT"):
        hil.connect("127.0.0.1:a port")
    with pytest.raises(NetworkError, match="to whom"):
        hil.connect()


def test_a_router_is_distinguished_from_a_slave(tmp_path: Path) -> None:
    """A client that connects to a router gets an error with the option to add; a slave, the command to start."""
    port = free_port()
    scenario, _ = write_scenario(tmp_path)
    options = ("--connect", f"tcp/127.0.0.1:{port}", "--output", tmp_path / "run", "--wait", 1)
    with Program(tmp_path, "router", "--listen", f"tcp/127.0.0.1:{port}") as router:
        router.expect("forwarding")
        with (
            hil.connect(f"tcp/127.0.0.1:{port}", wait=0.3) as fleet,
            pytest.raises(NetworkError, match=r'a router does.*mode = "routed".*routed=True'),
        ):
            _ = fleet.vehicles
        with Program(tmp_path, "master", scenario, *options) as master:
            assert master.wait() == 4
            assert '[network] mode = "routed"' in master.output
    scenario.write_text(scenario.read_text() + f'[network]\nmode = "routed"\nrouter = "tcp/127.0.0.1:{port}"\n')
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect(f"router tcp/127.0.0.1:{port} is not reached: .*is `uuv-hil router` running")


def test_a_recording_of_all_command_kinds_repeats_bit_for_bit(tmp_path: Path) -> None:
    scenario, port = write_scenario(tmp_path)
    folder = tmp_path / "recordings"
    scenario.write_text(scenario.read_text() + f'[recording]\nslave = true\nfolder = "{folder}"\n')
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("ready")
        with hil.connect(f"tcp/127.0.0.1:{port}", wait=60.0) as fleet:
            vehicle = fleet["uuv1"]
            north, east, depth = vehicle.state.position
            kinds: list[Callable[[], object]] = [
                lambda: vehicle.drive(surge=0.2, depth=depth + 0.1, heading=0.2),
                lambda: vehicle.go_to(north + 1.0, east, depth),
                lambda: vehicle.push(x=10.0),
                lambda: vehicle.thrust(3.0, 3.0, -3.0, -3.0, 1.0, 1.0),
            ]
            publishers = vehicle.client._publishers

            def reported(min_count: int) -> bool:
                return sum(publisher.sequence for publisher in publishers.values()) >= min_count

            for number, tell in enumerate(kinds, 1):
                tell()
                assert wait_for(functools.partial(reported, 15 * number)), (
                    "20 commands a second, of one to three topics"
                )
            vehicle.client.session.publisher("uuv1", Topic("cmd_other", "std_msgs/msg/Bool", 0, "data")).put(b"x", 0)
            time.sleep(0.1)
        assert slave.stop(signal.SIGTERM) == 0
        assert "Traceback" not in slave.output
    (recording,) = folder.iterdir()
    code, output = run_here("recording", "replay", str(recording), "--check")
    assert (code, "the same bit for bit" in output) == (0, True), output
    counts = Counter(message.topic.removeprefix("/uuv1/") for message in read_messages(str(recording)))
    assert all(counts[name] >= 2 for name in COMMANDS if name not in ("cmd_vel_stamped", "cmd_accessories")), counts


def test_two_anonymous_ros_publishers_of_different_topics_command_together(
    own_slave: tuple[Program, str], tmp_path: Path
) -> None:
    """One publishes depths and one velocities, neither with a name; a second publisher of depths is refused."""
    _, endpoint = own_slave
    arguments = ("--rate", 20, "--connect", endpoint)
    depths = ("topic", "pub", "/uuv1/cmd_depth", "std_msgs/msg/Float64")
    speeds = ("topic", "pub", "/uuv1/cmd_vel", "geometry_msgs/msg/Twist", "{linear: {x: 0.3}}")
    with (
        hil.connect(endpoint, observe=True, wait=60.0) as fleet,
        Program(tmp_path, *depths, "{data: 2.4}", *arguments),
        Program(tmp_path, *speeds, *arguments),
    ):
        vehicle = fleet["uuv1"]
        assert wait_for(lambda: vehicle.state.depth > 2.2 and vehicle.state.velocity[0] > 0.2)
        assert vehicle.diagnostics.commands_refused == 0
        with Program(tmp_path, *depths, "{data: 0.5}", *arguments):
            assert wait_for(lambda: (vehicle.diagnostics.commands_refused or 0) > 5)
        assert vehicle.state.depth > 2.1
