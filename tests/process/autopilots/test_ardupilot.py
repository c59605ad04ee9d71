"""The interface to ArduPilot, over real sockets: lockstep, resent packets, restarts, other senders, stalls."""

import itertools
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hil.autopilots.run import AutopilotRun
from hil.common.errors import DeviceError
from hil.common.ports import free_ports
from hil.scenario.config import load_scenario
from tests.support.autopilots.ardupilot_peer import ArdupilotPeer
from tests.support.processes import wait_for

SCENARIO = """
vehicle = "bluerov2"
world = "open_water"
controller = "ardupilot"
master = {{}}
[start]
north = 20
east = 20
depth = 5
[autopilot]
address = "udp://127.0.0.1:{port}"
{autopilot}
[sensors.imu]
rate = 400
[sensors.altimeter]
{sensors}
"""
FORWARD_PWM_US = (1400, 1400, 1600, 1600, 1500, 1500)


class Bench:
    """A run whose steps go in a thread as the peer asks for them, and what it reported."""

    def __init__(self, folder: Path, autopilot: str = "", sensors: str = "") -> None:
        self.port = free_ports(1)[0]
        path = folder / "bench.toml"
        path.write_text(SCENARIO.format(port=self.port, autopilot=autopilot, sensors=sensors))
        self.reports: list[str] = []
        self.run = AutopilotRun(load_scenario(str(path)), self.reports.append)
        self._thread: threading.Thread | None = None

    def steps(self, number: int) -> None:
        """Let the simulation take so many steps, in a thread."""

        def run() -> None:
            for _ in range(number):
                self.run.step()

        self._thread = threading.Thread(target=run, daemon=True)
        self._thread.start()

    def join(self) -> None:
        assert self._thread
        self._thread.join(30)
        assert not self._thread.is_alive()


@contextmanager
def bench(folder: Path, **options: str) -> Iterator[Bench]:
    made = Bench(folder, **options)
    with made.run:
        yield made


@pytest.mark.parametrize("channels", [16, 32])
def test_each_servo_packet_advances_the_simulation_by_one_step(tmp_path: Path, channels: int) -> None:
    with bench(tmp_path) as b:
        peer = ArdupilotPeer(b.port, channels)
        b.steps(800)
        first = peer.step(*[1500] * 6)
        times = [peer.step(*FORWARD_PWM_US)["timestamp"] for _ in range(799)]
        b.join()
        assert all(abs(later - sooner - 0.0025) < 1e-9 for sooner, later in itertools.pairwise(times))
        assert peer.position[0] - first["position"][0] > 0.1  # ahead is north
        assert abs(peer.position[1] - first["position"][1]) < 0.05
        assert b.run.pwm_us == FORWARD_PWM_US
        figures = b.run.autopilot.figures
        assert (figures.outputs, figures.states, figures.lost, figures.duplicates) == (800, 800, 0, 0)
        assert peer.state["rng_1"] == pytest.approx(25.0, abs=0.5)
        assert peer.state["imu"]["accel_body"][2] == pytest.approx(-9.8, abs=0.8)
        peer.close()


def test_reported_depth_comes_from_the_pressure_sensor_with_its_error(tmp_path: Path) -> None:
    with bench(tmp_path, sensors="[sensors.pressure]\nrate = 50\nerror = { offset = 10045.0 }") as b:
        peer = ArdupilotPeer(b.port)
        b.steps(20)
        for _ in range(20):
            peer.step(*[1500] * 6)
        b.join()
        assert peer.position[2] == pytest.approx(6.0, abs=0.05)  # a metre more than it is deep
        peer.close()


def test_a_resent_packet_is_answered_without_a_simulation_step(tmp_path: Path) -> None:
    with bench(tmp_path) as b:
        peer = ArdupilotPeer(b.port)
        b.steps(3)
        peer.step(*FORWARD_PWM_US)
        peer.step(*FORWARD_PWM_US)
        peer.count -= 1  # the answer got lost: the same frame again
        answer = peer.step(*FORWARD_PWM_US)
        b.join()
        assert answer["timestamp"] == pytest.approx(0.005)
        assert b.run.autopilot.figures.duplicates == 1
        peer.close()


def test_a_restarted_autopilot_begins_at_time_zero(tmp_path: Path) -> None:
    with bench(tmp_path) as b:
        peer = ArdupilotPeer(b.port)
        b.steps(405)
        for _ in range(400):
            peer.step(*FORWARD_PWM_US)
        peer.count = 0
        assert peer.step(*[0] * 6)["timestamp"] == pytest.approx(0.0025, abs=0.003)
        assert peer.step(*[0] * 6)["timestamp"] == pytest.approx(0.005, abs=0.003)
        for _ in range(3):
            peer.step(*[0] * 6)
        b.join()
        assert b.run.pwm_us == (1500,) * 6
        assert b.run.autopilot.figures.resets == 1
        assert "has restarted (frame 0 after 399)" in b.reports[-1]
        peer.close()


def test_a_second_autopilot_is_ignored_and_reported(tmp_path: Path) -> None:
    with bench(tmp_path) as b:
        peer, other_peer = ArdupilotPeer(b.port), ArdupilotPeer(b.port)
        b.steps(2)
        peer.step(*FORWARD_PWM_US)
        other_peer.send(*[1900] * 6)
        peer.step(*FORWARD_PWM_US)
        b.join()
        assert b.run.pwm_us == FORWARD_PWM_US
        assert "a second autopilot sends from port" in b.reports[-1]
        other_peer.close()
        peer.close()


def test_a_missing_autopilot_is_reported_with_how_to_start_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil.autopilots.ardupilot.ABSENT_NS", 200_000_000)
    with bench(tmp_path) as b:
        assert "--home 50.0000000,8.0000000,0,0.0 --defaults bench.parm" in b.reports[0]  # at once
        assert "--sim-port-out" in b.reports[0]
        b.steps(1)
        assert wait_for(lambda: any("no servo packet yet" in report for report in b.reports))
        peer = ArdupilotPeer(b.port)
        peer.step(*FORWARD_PWM_US)  # and then it goes on
        b.join()
        peer.close()


def test_a_malformed_packet_is_counted(tmp_path: Path) -> None:
    with bench(tmp_path) as b:
        peer = ArdupilotPeer(b.port)
        b.steps(1)
        peer.socket.sendto(b"hello", ("127.0.0.1", b.port))
        peer.step(*FORWARD_PWM_US)
        b.join()
        assert b.run.autopilot.figures.malformed == 1
        peer.close()


def test_without_lockstep_packets_are_answered_at_once_with_the_newest_state(tmp_path: Path) -> None:
    """The simulation goes by the clock without lockstep: its time does not depend on how often it gets outputs."""
    with bench(tmp_path, autopilot="lockstep = false") as b:
        peer = ArdupilotPeer(b.port)
        b.steps(1000)
        while peer.count < 5:
            peer.step(*FORWARD_PWM_US)
        last = peer.time
        b.join()  # nobody asks any more, and it goes on, its thrusters neutral
        assert b.run.simulation.time_ns == 2_500_000_000
        assert 0.0 < last < 2.5
        assert b.run.pwm_us == (1500,) * 6
        assert b.run.motors.silences == 1
        peer.close()


def test_an_autopilot_program_that_ends_is_reported_with_its_last_output(tmp_path: Path) -> None:
    program = tmp_path / "ardusub"
    program.write_text("#!/bin/sh\necho cannot find my eeprom\nexit 3\n")
    program.chmod(0o755)
    with (
        bench(tmp_path, autopilot=f'program = "{program}"\nfolder = "{tmp_path}/files"') as b,
        pytest.raises(DeviceError) as caught,
    ):
        b.run.step()
    assert "ended with status 3: cannot find my eeprom" in str(caught.value)
