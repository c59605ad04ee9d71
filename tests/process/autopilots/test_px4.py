"""The HIL interface to PX4, over real sockets and ptys: boot, lockstep, disconnection, boards."""

import itertools
import os
import pty
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from math import hypot, isfinite, isnan
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autopilots.run import AutopilotRun
from hil.common.errors import DeviceError
from hil.common.ports import free_ports
from hil.links.contract import Counters
from hil.links.mavlink.stream import MavlinkStream
from hil.scenario.config import load_scenario
from tests.support.autopilots.px4_peer import Px4Peer

SCENARIO = """
vehicle = "bluerov2_heavy"
world = "{world}"
controller = "px4"
master = {{}}
[start]
north = 20
east = 20
depth = {depth}
[slave]
step = 0.004
[autopilot]
{autopilot}
[sensors.imu]
rate = 250
[sensors.pressure]
rate = 50
{sensors}
"""
WORLD = """
name = "here"
source = "made up"
extent = [-50, 50, -50, 50]
depth = 30.0
origin = [50.0, 8.0]
magnetic_field = [49e-6, 1.15, 0.0]
"""


class Bench:
    """A run whose steps go in a thread, and what it reported."""

    def __init__(self, folder: Path, autopilot: str = "", sensors: str = "", depth: float = 5.0) -> None:
        self.port = free_ports(1)[0]
        world, path = folder / "here.toml", folder / "bench.toml"
        world.write_text(WORLD)
        autopilot = autopilot or f'address = "tcp://127.0.0.1:{self.port}"'
        path.write_text(SCENARIO.format(world=world, autopilot=autopilot, sensors=sensors, depth=depth))
        self.reports: list[str] = []
        self.run = AutopilotRun(load_scenario(str(path)), self.reports.append)
        self.stopping = False
        self.thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        while not self.stopping:
            try:
                self.run.step()
            except (DeviceError, ValueError, OSError):  # the test has ended
                return

    def wait_report(self, message: str) -> None:
        deadline = time.monotonic() + 30
        while not any(message in report for report in self.reports):
            assert time.monotonic() < deadline, self.reports
            time.sleep(0.01)


@contextmanager
def bench(folder: Path, autopilot: str = "", sensors: str = "", depth: float = 5.0) -> Iterator[Bench]:
    bench = Bench(folder, autopilot, sensors, depth)
    with bench.run:
        bench.thread.start()
        yield bench
        bench.stopping = True


@pytest.fixture(autouse=True)
def camera(monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """PX4's port for a camera, one of this test: a real PX4 on this machine would take the origin sent to its own."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as camera:
        camera.bind(("127.0.0.1", 0))
        camera.settimeout(10.0)
        monkeypatch.setattr("hil.autopilots.px4.CAMERA_PORT", camera.getsockname()[1])
        yield camera


def test_px4_boots_by_the_wall_clock_and_then_runs_in_lockstep(tmp_path: Path) -> None:
    with bench(tmp_path) as b:
        peer = Px4Peer(b.port)
        booting = [peer.sensor() for _ in range(50)]  # unanswered, and yet they go on
        assert {later.time_usec - sooner.time_usec for sooner, later in itertools.pairwise(booting)} == {4000}
        for _ in range(500):
            sensor = peer.sensor()
            peer.send_reply(sensor, (0.5, 0.5, -0.5, -0.5))  # ahead, with von Benzon's directions
        last = peer.sensor()
        time.sleep(0.2)
        assert not peer._sensors  # it waits for the answer
        assert peer.last["HIL_SENSOR"].time_usec == last.time_usec
        position = b.run.simulation.state.position
        assert position[0] > 20.3
        assert abs(position[1] - 20.0) < 0.05
        assert {"HIL_SENSOR", "ODOMETRY", "HIL_STATE_QUATERNION", "HEARTBEAT"} <= set(peer.received)
        assert peer.last["HIL_SENSOR"].fields_updated & 0x1FF == 0x1FF
        peer.close()


def test_outputs_of_a_disarmed_px4_are_neutral(tmp_path: Path) -> None:
    with bench(tmp_path) as b:
        peer = Px4Peer(b.port)
        for _ in range(20):
            peer.send_reply(peer.sensor(), (1.0,) * 8, armed=False)
        peer.sensor()
        assert b.run.pwm_us == (1500,) * 8
        peer.close()


def test_gps_has_a_fix_at_the_surface_only(tmp_path: Path) -> None:
    for depth, fix in ((0.0, 3), (5.0, 0)):
        gps = "[sensors.gps]\nrate = 10\nacquisition = 0\nposition = [0, 0, -0.3]"
        with bench(tmp_path, sensors=gps, depth=depth) as b:
            peer = Px4Peer(b.port)
            while "HIL_GPS" not in peer.last:
                peer.send_reply(peer.sensor(), ())
            assert peer.last["HIL_GPS"].fix_type == fix
            peer.close()


def test_positions_by_dvl_are_a_depth_and_a_velocity_while_it_has_lock(tmp_path: Path) -> None:
    """The world is 30 m deep: 25 m above the bed a DVL with a range of 20 m has none, and says so.

    There is no depth either from a pressure sensor that is silent.
    """
    for reach, has_lock, lost in ((50, True, 0), (20, False, 0), (50, True, 1)):
        port = free_ports(1)[0]
        keys = f'address = "tcp://127.0.0.1:{port}"\npositions = "dvl"'
        dvl = f"drop_out = {lost}\n[sensors.dvl]\nrate = 10\nmax_range = {reach}\nposition = [0, 0, 0.2]"
        with bench(tmp_path, keys, dvl):
            peer = Px4Peer(port)
            for _ in range(200):
                peer.send_reply(peer.sensor(), ())
            odometry = peer.last["ODOMETRY"]
            assert 5 <= peer.received["ODOMETRY"] <= 12  # as many as DVL samples, not as pressures
            assert isnan(odometry.z) if lost else odometry.z == pytest.approx(5.2, abs=0.1)  # the DVL's depth
            assert isfinite(odometry.vx) == has_lock
            assert not isfinite(odometry.q[0])
            peer.close()


def test_px4_gets_the_origin_and_a_field_that_is_not_constant_and_its_estimate_is_read(
    tmp_path: Path, camera: socket.socket
) -> None:
    with bench(tmp_path) as b:
        peer = Px4Peer(b.port)
        fields = []
        for _ in range(300):
            sensor = peer.sensor()
            fields.append(sensor.xmag)
            peer.send_reply(sensor, ())
        received = [camera.recvfrom(300) for _ in range(3)]
        *wanted, message = [peer.stream.unpack(data)[0] for data, _ in received]
        for answer in (
            dialect.MAVLink_attitude_message(0, 0.0, 0.0, 0.1, 0, 0, 0),
            dialect.MAVLink_global_position_int_message(0, 500_000_000, 80_000_000, 0, 0, 0, 0, 0, 0),
        ):
            camera.sendto(peer.stream.pack(answer), received[0][1])
        for _ in range(3):
            peer.send_reply(peer.sensor(), ())
        estimate, truth = b.run.autopilot.estimate, b.run.simulation.truth()
        peer.close()
    assert [request.param1 for request in wanted] == [30, 33]  # ATTITUDE, GLOBAL_POSITION_INT
    assert estimate
    assert estimate.yaw == pytest.approx(0.1, abs=0.01)
    assert estimate.position == pytest.approx(hypot(*truth.position), abs=0.1)
    assert (message.latitude, message.longitude, message.target_system) == (500_000_000, 80_000_000, 1)
    assert all(1e-5 < abs(a - b) < 1e-3 for a, b in itertools.pairwise(fields))  # gauss


def test_a_stalled_px4_and_a_disconnected_one_are_distinguished(tmp_path: Path) -> None:
    with bench(tmp_path) as b:
        peer = Px4Peer(b.port)
        peer.send_reply(peer.sensor(), ())
        peer.send_reply(peer.sensor(), ())
        sensor = peer.sensor()
        b.wait_report("lockstep stalls")
        peer.send_reply(sensor, ())
        b.wait_report("it replies again")
        peer.close()
        b.wait_report("PX4 has disconnected; it does not connect again by itself")
        other_peer = Px4Peer(b.port)
        other_peer.sensor()
        assert b.run.autopilot.figures.resets == 1
        other_peer.close()


def test_a_sensor_time_that_goes_back_is_reported_once(tmp_path: Path) -> None:
    with bench(tmp_path) as b:
        peer = Px4Peer(b.port)
        sensor = peer.sensor()
        peer.send_reply(sensor, ())
        sensor.time_usec -= 500_000
        peer.send_reply(sensor, ())
        b.wait_report("its time went back by 0.500 s")
        assert sum("went back" in report for report in b.reports) == 1, "once is enough"
        peer.close()


class Board:
    """A board on a pty: sends its heartbeat, or given noise."""

    def __init__(self) -> None:
        self.end, self._far_end = pty.openpty()
        self.path = os.ttyname(self._far_end)
        os.set_blocking(self.end, False)
        self.stream = MavlinkStream(1, 1, Counters())
        self.received: list[str] = []

    def send(self, message: object) -> None:
        os.write(self.end, self.stream.pack(message))

    def read(self) -> None:
        try:
            data = os.read(self.end, 65_536)
        except BlockingIOError:
            return
        self.received += [message.get_type() for message in self.stream.unpack(data)]

    def close(self) -> None:
        os.close(self.end)
        os.close(self._far_end)


def test_a_board_on_a_serial_line_runs_by_the_wall_clock_without_lockstep(tmp_path: Path) -> None:
    board = Board()
    with bench(tmp_path, autopilot=f'address = "{board.path}"') as b:
        assert not b.run.autopilot.lockstep
        board.send(dialect.MAVLink_heartbeat_message(12, dialect.MAV_AUTOPILOT_PX4, 0, 0, 4, 3))
        deadline = time.monotonic() + 30
        while b.run.pwm_us != (1700,) + (1500,) * 7:
            board.send(dialect.MAVLink_hil_actuator_controls_message(1, [0.5] + [0.0] * 15, 0x81, 0))
            board.read()
            time.sleep(0.02)
            assert time.monotonic() < deadline
        while b.run.pwm_us != (1500,) * 8:  # it says nothing any more: neutral after 0.2 s
            board.read()
            time.sleep(0.02)
            assert time.monotonic() < deadline
        assert "HIL_SENSOR" in board.received
        assert b.run.motors.silences >= 1
    board.close()


@pytest.fixture
def short_report_delay(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shorten the times after which missing input is reported from ten and more seconds to a fifth of one."""
    for name in ("ABSENT_NS", "BOOT_NS"):
        monkeypatch.setattr(f"hil.autopilots.px4.{name}", 200_000_000)


@pytest.mark.usefixtures("short_report_delay")
def test_a_missing_px4_is_reported_with_how_to_start_it(tmp_path: Path) -> None:
    with bench(tmp_path) as b:
        b.wait_report("nobody has connected: start PX4's SITL")
        assert not b.run.autopilot.connected


@pytest.mark.usefixtures("short_report_delay")
def test_each_cause_of_a_silent_board_is_reported(tmp_path: Path) -> None:
    """The board sends nothing, then what a wrong baud rate makes of it, then heartbeats without outputs."""
    board = Board()
    causes = "no heartbeat: check the cable", "the baud rate (921600) is wrong", "but no HIL_ACTUATOR_CONTROLS"
    with bench(tmp_path, autopilot=f'address = "{board.path}"') as b:
        b.wait_report(causes[0])
        assert not b.run.autopilot.connected
        os.write(board.end, bytes(range(256)) * 10)
        b.wait_report(causes[1])
        deadline = time.monotonic() + 30
        while not any(causes[2] in report for report in b.reports):
            board.send(dialect.MAVLink_heartbeat_message(12, dialect.MAV_AUTOPILOT_PX4, 0, 0, 4, 3))
            board.read()
            time.sleep(0.02)
            assert time.monotonic() < deadline, b.reports
        assert b.run.pwm_us == (1500,) * 8
    board.close()
