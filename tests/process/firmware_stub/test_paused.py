"""An STM32 whose process was stopped and continued does not execute commands that arrived meanwhile."""

import os
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import psutil
import pytest

from hil.links.address import open_address
from hil.links.contract import ThrusterCommand, ThrusterLink, ThrusterTelemetry
from hil.links.protocols import open_protocol
from hil.scenario.records import Link
from hil.slave.drivers.driver import open_driver
from tests.support.processes import Program, free_port, wait_for, write_scenario

WATCHDOG_S = 0.2
BEFORE, WHILE_STOPPED, NEUTRAL = (1600,) * 6, (1700,) * 6, (1500,) * 6
COMMANDS = 400  # 8.8 kB: more than the 4 kB that one read of a terminal can return
Paused = tuple[int, ThrusterLink]  # id of the process with the STM32, and the host's end of its link


def in_process(kind: str, wire: str) -> Callable[[Path], Iterator[Paused]]:
    """An STM32 in a process of its own, which a driver has started."""

    def start(folder: Path) -> Iterator[Paused]:
        if kind == "native" and not shutil.which("cc"):
            pytest.skip("needs a C compiler")
        port = f"udp://127.0.0.1:{free_port()}" if wire == "udp" else f"pty:{folder / 'stm32'}"
        with closing(open_driver(kind, Link(port=port, watchdog=WATCHDOG_S), 6, True, 1, print)) as driver:
            assert driver.host
            yield driver.children[0], driver.host

    return start


def in_slave(kind: str, wire: str, faults: str = "") -> Callable[[Path], Iterator[Paused]]:
    """An STM32 in the slave, which software of others commands."""

    def start(folder: Path) -> Iterator[Paused]:
        if kind == "unicorn":
            pytest.importorskip("unicorn")
        port = f"udp://127.0.0.1:{free_port()}" if wire == "udp" else f"pty:{folder / 'stm32'}"
        top, link = f'controller = "external"\nstm32 = "{kind}"', f'port = "{port}"\nwatchdog = {WATCHDOG_S}\n{faults}'
        scenario, _ = write_scenario(folder, top=top, link=link)
        with Program(folder, "slave", scenario) as slave:
            slave.expect("waiting for your software")
            wire_of_host = open_address(port, "host")
            with closing(ThrusterLink(wire_of_host, open_protocol("frame", "host", 6, frame="uuv_hil"))) as host:
                yield slave.process.pid, host

    return start


def pulses_of(host: ThrusterLink) -> set[tuple[int, ...]]:
    """Return the pulse widths in the reports that have arrived, to 10 us: a motor's duty is rounded otherwise."""
    reports = [message for message in host.receive() if isinstance(message, ThrusterTelemetry)]
    return {tuple(round(pulse, -1) for pulse in report.pwm_us) for report in reports}


@pytest.mark.parametrize(
    "start",
    [
        pytest.param(in_process("process", "pty"), id="process, pty"),
        pytest.param(in_process("process", "udp"), id="process, udp"),
        pytest.param(in_process("native", "pty"), id="native, pty"),
        pytest.param(in_slave("python", "pty"), id="slave, pty"),
        pytest.param(in_slave("python", "pty", "[link.faults]\ndelay = 0.3"), id="slave, slow pty"),
        pytest.param(in_slave("python", "udp"), id="slave, udp"),
        pytest.param(in_slave("unicorn", "pty"), id="slave, unicorn"),
    ],
)
def test_commands_that_arrived_while_it_was_stopped_are_discarded(
    start: Callable[[Path], Iterator[Paused]], tmp_path: Path
) -> None:
    with contextmanager(start)(tmp_path) as (pid, host):
        sequence = 0

        def command(pulses: tuple[int, ...]) -> None:
            nonlocal sequence
            sequence += 1
            host.send(ThrusterCommand(sequence, True, pulses))

        def executes() -> bool:
            command(BEFORE)
            return BEFORE in pulses_of(host)

        assert wait_for(executes)
        os.kill(pid, signal.SIGSTOP)
        try:
            assert wait_for(lambda: psutil.Process(pid).status() == psutil.STATUS_STOPPED)
            pulses_of(host)
            for _ in range(COMMANDS):
                command(WHILE_STOPPED)
            time.sleep(1.5 * WATCHDOG_S)  # at least: it is stopped for longer than its watchdog waits
        finally:
            os.kill(pid, signal.SIGCONT)
        reported_pulses: set[tuple[int, ...]] = set()

        def stops() -> bool:
            reported_pulses.update(pulses_of(host))
            return NEUTRAL in reported_pulses

        assert wait_for(stops)
        assert WHILE_STOPPED not in reported_pulses
        assert wait_for(executes), "and new commands count"
