"""Reaction of the thrusters when a part of the chain fails, measured at the STM32's end of a real pty.

The slave is a process of its own; the STM32's end is here, where it can be silenced, reset and unplugged.
"""

import random
import select
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from firmware_stub.stub import Stm32, Stm32End
from hil.autonomy.control.controller import VelocityCommand
from hil.client.client import VehicleClient
from hil.common.clock import now_ns
from hil.common.errors import DeviceError
from hil.links.contract import ThrusterLink
from hil.links.protocols import open_protocol
from hil.links.wires.terminal import PtyWire
from tests.support.processes import Program, wait_for, write_scenario

WATCHDOG_S, DEADMAN_S = 0.2, 0.5
SLACK_S = 3.0  # a busy machine wakes processes late; unit tests check the times themselves by a clock of their own
NEUTRAL = [1500] * 6


class Bench:
    """An STM32 on a pty of a fixed name, served by a thread, and a record of when its outputs changed."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.changes: list[tuple[float, bool]] = []  # when, and whether neutral from then on
        self.silent = False
        self._running = True
        self.plug()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def plug(self) -> None:
        self.end = Stm32End(Stm32(6), ThrusterLink(PtyWire(str(self.path)), open_protocol("frame", "device", 6)))

    def unplug(self) -> None:
        end, self.silent = self.end, True
        time.sleep(0.05)  # the thread is through with it
        end.close()

    def replug(self) -> None:
        self.plug()
        self.silent = False

    def reset(self) -> None:
        """Reset the STM32 as its reset pin does: all state is lost."""
        self.end.stm32 = Stm32(6)

    @property
    def spinning(self) -> bool:
        return self.end.stm32.pwm_us != NEUTRAL

    def neutral_after(self, since: float) -> float:
        """Return seconds from `since` until the outputs were neutral for good."""
        assert wait_for(lambda: not self.spinning), "the thrusters still turn"
        time.sleep(0.1)
        assert not self.spinning
        return next(t for t, neutral in reversed(self.changes) if neutral) - since

    def close(self) -> None:
        self._running = False
        self._thread.join(5.0)
        self.end.close()

    def _serve(self) -> None:
        was = None
        while self._running:
            if self.silent:
                time.sleep(0.005)
                continue
            try:
                select.select([self.end.fileno()], [], [], 0.005)
                self.end.service(now_ns())
            except (DeviceError, ValueError):
                continue
            neutral = not self.spinning
            if neutral != was:
                self.changes.append((time.monotonic(), neutral))
                was = neutral


class Master:
    """A planner that sends a command 20 times a second until it is stopped."""

    def __init__(self, client: VehicleClient) -> None:
        self.client = client
        self.is_commanding = True
        self._running = True
        self._thread = threading.Thread(target=self._send_commands)
        self._thread.start()

    def _send_commands(self) -> None:
        while self._running:
            if self.is_commanding:
                self.client.command(VelocityCommand(surge=0.4))
            time.sleep(0.05)

    def close(self) -> None:
        self._running = False
        self._thread.join(5.0)


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[tuple[Program, Bench, Master]]:
    bench = Bench(tmp_path / "ttySTM32")
    scenario, port = write_scenario(tmp_path, top='stm32 = "device"', link=f'port = "{bench.path}"')
    try:
        with Program(tmp_path, "slave", scenario) as slave:
            slave.expect("ready")
            with VehicleClient(f"tcp/127.0.0.1:{port}", "uuv1") as client:
                assert client.wait_for_vehicle(60)
                master = Master(client)
                try:
                    assert wait_for(lambda: bench.spinning)
                    time.sleep(0.3)
                    yield slave, bench, master
                finally:
                    master.close()
    finally:
        bench.close()


@pytest.fixture
def slave(rig: tuple[Program, Bench, Master]) -> Program:
    return rig[0]


@pytest.fixture
def bench(rig: tuple[Program, Bench, Master]) -> Bench:
    return rig[1]


@pytest.fixture
def master(rig: tuple[Program, Bench, Master]) -> Master:
    return rig[2]


def assert_running_again(bench: Bench, slave: Program) -> None:
    """Assert that the thrusters start again by themselves, in the same slave process."""
    assert wait_for(lambda: bench.spinning), slave.output
    assert slave.process.poll() is None, slave.output
    assert "Traceback" not in slave.output


def test_the_thrusters_stop_when_the_master_is_silent(slave: Program, bench: Bench, master: Master) -> None:
    for attempt in (1, 2):
        master.is_commanding = False
        silent = time.monotonic()
        assert bench.neutral_after(silent) < DEADMAN_S + SLACK_S
        assert slave.output.count("deadman: no command in time, stopping the thrusters") >= attempt
        master.is_commanding = True
        assert_running_again(bench, slave)


def test_the_thrusters_stop_when_the_slave_is_killed(slave: Program, bench: Bench, master: Master) -> None:
    trips = bench.end.stm32.watchdog_trips
    slave.process.send_signal(signal.SIGKILL)
    killed = time.monotonic()
    assert bench.neutral_after(killed) < WATCHDOG_S + SLACK_S
    assert bench.end.stm32.watchdog_trips > trips


def test_the_thrusters_stop_while_the_slave_is_paused(slave: Program, bench: Bench, master: Master) -> None:
    slave.process.send_signal(signal.SIGSTOP)
    stopped = time.monotonic()
    assert bench.neutral_after(stopped) < WATCHDOG_S + SLACK_S
    time.sleep(1.0)
    slave.process.send_signal(signal.SIGCONT)
    assert_running_again(bench, slave)
    slave.expect("the STM32's watchdog tripped")


def test_the_simulated_thrusters_stop_while_the_stm32_is_silent(slave: Program, bench: Bench, master: Master) -> None:
    """The simulated thrusters stop as the watchdog of the STM32 would stop the real ones; then all continues."""
    bench.silent = True
    assert wait_for(lambda: master.client.diagnostics().pwm_us == tuple(NEUTRAL)), slave.output
    slave.expect(f"{bench.path}: the STM32 has not answered for 0.5 s; check wiring, baud, protocol")
    assert wait_for(lambda: (master.client.diagnostics().commands_unanswered or 0) > 10)
    bench.silent = False
    assert_running_again(bench, slave)
    slave.expect(f"{bench.path}: the STM32 answers, after")


def test_the_thrusters_start_again_after_a_reset_of_the_stm32(slave: Program, bench: Bench, master: Master) -> None:
    bench.reset()
    assert_running_again(bench, slave)
    slave.expect("the STM32 has restarted")
    time.sleep(0.5)
    assert slave.output.count("the STM32 has restarted") == 1


def test_noise_from_the_stm32_is_counted_and_commands_still_work(slave: Program, bench: Bench, master: Master) -> None:
    """A broken driver sends a second of noise at 921 600 bit/s: it is counted, and commands still work."""
    noise, end = random.Random(1), time.monotonic() + 1.0
    written_bytes = 0
    while time.monotonic() < end:
        written_bytes += bench.end.link.wire.write(noise.randbytes(900))
        time.sleep(0.01)
    assert written_bytes > 40_000
    assert_running_again(bench, slave)

    def dropped() -> bool:
        figures = master.client.diagnostics()
        return (figures.link_dropped_bytes or 0) > 20_000 and figures.link_checksum_errors is not None

    assert wait_for(dropped), master.client.diagnostics()
    master.is_commanding = False
    assert bench.neutral_after(time.monotonic()) < DEADMAN_S + SLACK_S


def test_a_flood_towards_the_stm32_stops_the_thrusters_only_while_it_lasts(
    slave: Program, bench: Bench, master: Master
) -> None:
    """Another program fills the port: too few commands arrive, and the STM32's watchdog trips."""
    with open(bench.path, "wb", buffering=0) as port, subprocess.Popen(["cat", "/dev/urandom"], stdout=port) as cat:
        stopped = wait_for(lambda: not bench.spinning)
        cat.terminate()
    assert stopped
    assert_running_again(bench, slave)


def test_the_thrusters_start_again_after_the_port_was_unplugged(slave: Program, bench: Bench, master: Master) -> None:

    def reported(text: str, times: int) -> bool:
        return bool(wait_for(lambda: slave.output.count(text) == times))

    for attempt in (1, 2):
        bench.unplug()
        assert bench.end.stm32.pwm_us == NEUTRAL
        assert reported("thruster link lost, the STM32's watchdog stops the thrusters", attempt), slave.output
        time.sleep(0.7)
        bench.replug()
        assert_running_again(bench, slave)
        assert reported("thruster link back after", attempt), slave.output
    assert f"{bench.path}: went away" in slave.output
    assert wait_for(lambda: master.client.diagnostics().link_losses == 2)
