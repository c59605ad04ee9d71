"""An STM32 process that was stopped and continued does not execute commands that arrived meanwhile."""

import contextlib
import os
import signal
import time
from pathlib import Path

import psutil
import pytest

from hil.common.clock import now_ns
from hil.links.contract import ThrusterCommand
from hil.scenario.records import Link
from hil.slave.drivers.driver import ThrusterDriver, open_driver
from tests.support.processes import free_port, wait_for

WATCHDOG_S = 0.2
BEFORE, WHILE_STOPPED = (1600,) * 6, (1700,) * 6
COMMANDS = 400  # 8.8 kB: more than the 4 kB that one read of a terminal can return


def reports(driver: ThrusterDriver) -> set[tuple[int, ...]]:
    return {telemetry.pwm_us for telemetry in driver.service(now_ns())}


@pytest.mark.parametrize(("kind", "wire"), [("process", "pty"), ("process", "udp"), ("native", "pty")])
def test_commands_that_arrived_while_it_was_stopped_are_discarded(kind: str, wire: str, tmp_path: Path) -> None:
    port = f"udp://127.0.0.1:{free_port()}" if wire == "udp" else f"pty:{tmp_path / 'stm32'}"
    driver = open_driver(kind, Link(port=port, watchdog=WATCHDOG_S), 6, True, 1, print)
    with contextlib.closing(driver):
        sequence = 0

        def command(pulses: tuple[int, ...]) -> None:
            nonlocal sequence
            sequence += 1
            driver.send(ThrusterCommand(sequence, True, pulses))

        def executes() -> bool:
            command(BEFORE)
            return BEFORE in reports(driver)

        assert wait_for(executes)
        os.kill(driver.children[0], signal.SIGSTOP)
        try:
            stm32 = psutil.Process(driver.children[0])
            assert wait_for(lambda: stm32.status() == psutil.STATUS_STOPPED)
            reports(driver)
            for _ in range(COMMANDS):
                command(WHILE_STOPPED)
            time.sleep(1.5 * WATCHDOG_S)
        finally:
            os.kill(driver.children[0], signal.SIGCONT)
        reported_pulses: set[tuple[int, ...]] = set()

        def stops() -> bool:
            reported_pulses.update(reports(driver))
            return (1500,) * 6 in reported_pulses

        assert wait_for(stops)
        assert WHILE_STOPPED not in reported_pulses
        assert wait_for(executes), "and new commands count"
