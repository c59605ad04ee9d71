"""An STM32 that does not answer (wrong wiring, baud or protocol) is reported and counted without growing memory."""

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.common.clock import NS_PER_S
from hil.common.errors import ConfigError, DeviceError
from hil.links.contract import ThrusterCommand, ThrusterTelemetry
from hil.scenario.config import load_scenario
from hil.scenario.records import Link
from hil.slave import command_source, pilot_source
from hil.slave import loop as slave_loop
from hil.slave.command_receiver import Received
from hil.slave.drivers import driver as stm32
from hil.slave.drivers.driver import open_driver, stop_thrusters
from hil.slave.drivers.external import ExternalDriver, open_device, open_native
from hil.slave.loop import Loop
from hil.slave.pilot import build_pilot
from hil.slave.pilot_source import PilotSource
from hil.slave.ros.services import _arm
from sim.environment.world import load_world
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle
from tests.support.links.bench_link import BenchLink
from tests.support.processes import wait_for

NEUTRAL = (1500,) * 6
WATCHDOG_NS = NS_PER_S
COMMAND = ThrusterCommand(1, True, NEUTRAL)
TELEMETRY = ThrusterTelemetry(1, True, False, NEUTRAL, 0, 1, 0, 0)
SILENT = "/dev/bench: the STM32 has not answered for 0.5 s; check wiring, baud, protocol"


@pytest.fixture
def stop_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stop the clock of the drivers and of the loop, so that only the time that a test adds passes."""
    for module in (stm32, slave_loop, command_source, pilot_source):
        monkeypatch.setattr(module, "now_ns", lambda: 10**12)


def now_ns() -> int:
    """Return the time by the clock of the drivers."""
    return int(vars(stm32)["now_ns"]())


class Bed:
    """A driver on a bench, checked some seconds after its first command."""

    def __init__(self) -> None:
        self.bench, self.output = BenchLink(), list[str]()
        self.driver = ExternalDriver(self.bench.bench_ends, 6, WATCHDOG_NS, self.output.append)

    def check_after(self, seconds: float) -> None:
        self.driver.service(now_ns() + round(seconds * NS_PER_S))

    def check_until(self, seconds: float, lines: int) -> None:
        """Check repeatedly until so many lines have been reported."""

        def output() -> bool:
            self.check_after(seconds)
            return len(self.output) == lines

        assert wait_for(output), self.output

    def receive(self, seconds: float) -> None:
        self.bench.reports = [TELEMETRY]
        self.check_after(seconds)


@pytest.mark.usefixtures("stop_clock")
def test_a_silent_stm32_is_reported_once_and_so_is_its_return() -> None:
    bed = Bed()
    for start_s in (0.0, 10.0):
        bed.driver.send(COMMAND)
        bed.check_after(0.5)
        assert not bed.driver.is_silent
        bed.output.clear()
        for later in (0.6, 0.8, 5.0):
            bed.driver.send(COMMAND)
            bed.check_after(later)
        assert bed.output == [SILENT], start_s
        assert bed.driver.is_silent
        bed.receive(6.0)
        bed.receive(6.1)
        assert bed.output == [SILENT, "/dev/bench: the STM32 answers, after 6.0 s"]
        assert not bed.driver.is_silent


@pytest.mark.usefixtures("stop_clock")
def test_no_reply_is_expected_without_a_command() -> None:
    """No answer is missing before the first command, between two, and where another program has the host's end."""
    bed = Bed()
    bed.check_after(5.0)
    bed.driver.send(COMMAND)
    bed.receive(0.1)
    bed.check_after(5.0)
    assert bed.output == []


@pytest.mark.usefixtures("stop_clock")
def test_a_lost_link_is_not_also_reported_as_silent() -> None:
    bed = Bed()
    bed.driver.send(COMMAND)
    bed.check_after(1.0)
    bed.bench.broken = True
    bed.check_after(2.0)
    assert bed.driver.lost
    assert not bed.driver.is_silent
    bed.bench.broken = False
    bed.driver.send(COMMAND)
    bed.check_until(4.0, lines=3)
    assert not bed.driver.lost
    assert [line.partition(":")[0][:24] for line in bed.output] == [
        "/dev/bench", "thruster link lost, the ", "thruster link back after"
    ]  # fmt: skip
    bed.driver.send(COMMAND)
    bed.check_after(6.0)
    assert bed.output[3:] == [SILENT]


def test_a_silent_or_lost_stm32_confirms_no_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("CONFIRM_NS", "SETTLE_NS"):
        monkeypatch.setattr(stm32, name, NS_PER_S // 100)
    bed = Bed()
    bed.driver.descriptors = []  # a bench has none to wait on
    bed.bench.reports = [TELEMETRY]
    assert stop_thrusters(bed.driver, 2)
    assert not stop_thrusters(bed.driver, 2), "an earlier report does not confirm it"
    bed.bench.reports = [TELEMETRY._replace(pwm_us=(1500, 1600, 1500, 1500, 1500, 1500))]
    assert not stop_thrusters(bed.driver, 2)
    bed.bench.broken = True
    bed.check_after(2.0)
    assert tuple(bed.driver.pwm_us) == NEUTRAL
    assert not stop_thrusters(bed.driver, 2), "a lost link counts as neutral, which does not confirm it"
    bed.driver.close()


def test_a_stop_waits_long_only_for_an_stm32_that_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stm32, "CONFIRM_NS", 20 * NS_PER_S)
    bed, began = Bed(), time.monotonic()
    bed.driver.descriptors, bed.driver.is_silent = [], True
    assert not stop_thrusters(bed.driver, 2)
    assert time.monotonic() - began < 15.0


def test_neutral_is_repeated_until_it_is_confirmed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stm32, "CONFIRM_NS", 60 * NS_PER_S)
    bed, sent, times_ns = Bed(), list[ThrusterCommand](), list[int]()
    bed.driver.descriptors = []

    def lose_two_replies(command: ThrusterCommand) -> None:
        sent.append(command)
        times_ns.append(time.monotonic_ns())
        bed.bench.reports = [TELEMETRY] * (len(sent) > 2)

    monkeypatch.setattr(bed.bench, "send", lose_two_replies)
    assert stop_thrusters(bed.driver, 0xFFFF)
    assert [(command.sequence, command.armed) for command in sent] == [(0xFFFF, False), (0, False), (1, False)]
    assert times_ns[2] - times_ns[0] > 1.5 * stm32.REPEAT_NS


class Master:
    """A command receiver that always has a new command."""

    def take_latest(self) -> Received:
        return Received(VelocityCommand(surge=0.2), 1, 0, now_ns())


@pytest.fixture
def loop(tmp_path: Path) -> Iterator[Loop]:
    """Return a loop whose device is a terminal without a reader."""
    scenario = load_scenario("paper_field")
    vehicle, control = load_vehicle(scenario.vehicle)
    world = load_world(scenario.world)
    near_end, far_end = os.openpty()
    driver = open_driver("device", Link(port=os.ttyname(far_end)), len(vehicle.channels), True, 1, print)
    unused: Any = None
    master: Any = Master()
    pilot = build_pilot(scenario, vehicle, control, world)
    source = PilotSource(pilot, driver, master, 20_000_000, 2_500_000, unused, print)
    yield Loop(Simulation(vehicle, world), driver, source, unused, 2_500_000, print)
    driver.close()
    os.close(near_end)
    os.close(far_end)


@pytest.mark.usefixtures("stop_clock")
def test_a_link_lost_while_sending_is_no_longer_waited_on(loop: Loop) -> None:
    """The link's descriptors may be those of something else by the next wait."""
    assert loop.driver.host
    assert loop._link_fds
    loop.pwm_us = (1600,) * 6
    loop.driver.host.wire.close()
    loop.serve_source(now_ns())
    assert loop.driver.lost
    assert loop._link_fds == []
    assert loop.pwm_us == NEUTRAL
    assert loop._link_due_ns == loop.driver.deadline_ns


@pytest.mark.usefixtures("stop_clock")
def test_a_line_that_is_too_slow_does_not_arm(loop: Loop, capsys: pytest.CaptureFixture[str]) -> None:
    assert loop.driver.host
    assert loop.source.pilot
    assert loop.driver.host.pace
    pace = loop.driver.host.pace
    loop.serve_source(now_ns())
    assert loop.source.pilot.active
    pace.rate, pace.is_slow = 7.0, True
    loop.service_link(now_ns())
    loop.serve_source(now_ns())
    assert not loop.source.pilot.active
    assert "carries 7 commands a second; at least 10 are needed" in capsys.readouterr().out
    lines = list[str]()
    answer = _arm(loop, True, lines.append)
    assert (answer["success"], lines) == (False, [f"arm: refused: {loop.driver.arming_refusal}"])
    pace.is_slow = False
    loop.service_link(now_ns())
    loop.serve_source(now_ns())
    assert loop.source.pilot.active
    assert _arm(loop, True, lines.append)["success"]


def test_a_real_stm32_needs_the_name_of_its_device() -> None:
    with pytest.raises(ConfigError, match=r"no device: set \[link\] port"):
        open_device(Link(port="pty:/tmp/uuv-hil-stm32"), 6, 1, host=True)


def test_what_was_started_ends_if_its_link_cannot_be_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ended: list[str] = []

    class Unlinked:
        """Firmware that makes no pty."""

        def __init__(self, target: str, *_: object) -> None:
            self.close, self.pid = lambda: ended.append(target), 1

    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr("firmware_stub.native.NativeStm32", Unlinked)
    with pytest.raises(DeviceError, match="no such device"):
        open_native(Link(), 6, 1, True)
    assert [Path(target).parent.parent for target in ended] == [tmp_path]
    assert not list(tmp_path.iterdir())
