"""When an STM32 in the slave's own process applied a command."""

import select
import time

import pytest

from hil.common.clock import NS_PER_S, now_ns
from hil.links.contract import ThrusterCommand
from hil.scenario.config import load_scenario
from hil.slave.drivers.driver import open_driver
from hil.slave.drivers.in_process import InProcessDriver
from tests.support.link_contract import PATIENCE_S, nothing_leaks


@pytest.mark.parametrize("kind", ["python", "unicorn"])
def test_the_instant_counts_what_reading_and_obeying_took(kind: str) -> None:
    """However old the instant is that the caller has: the outputs did not have the pulses before they were read."""
    with nothing_leaks():
        driver = open_driver(kind, load_scenario("paper_field").link, 6, True, 1, lambda _: None)
        for _ in range(3):
            driver.service(now_ns())
        for sequence in range(1, 6):
            stale = now_ns()
            time.sleep(0.002)
            driver.send(ThrusterCommand(sequence, True, (1500 + sequence,) * 6))
            sent = now_ns()
            heard = [telemetry for telemetry in driver.service(stale) if telemetry.sequence == sequence]
            assert heard, "it is answered at once"
            assert sent < driver.applied_ns(heard[0], stale) <= now_ns()
        driver.close()


def test_a_command_is_read_behind_a_heartbeat_that_still_lies_there() -> None:
    link = load_scenario("paper_field").link._replace(protocol="mavlink")
    with nothing_leaks():
        driver = open_driver("python", link, 6, True, 1, lambda _: None)
        for sequence in (1, 2):  # arms, which the device says itself
            driver.send(ThrusterCommand(sequence, True, (1510,) * 6))
            driver.service(now_ns())
        end = now_ns() + 3 * NS_PER_S
        while driver.deadline_ns and now_ns() < end:  # 0: the host's heartbeat was written and not read
            driver.service(max(now_ns(), driver.deadline_ns))
        assert driver.deadline_ns == 0
        assert isinstance(driver, InProcessDriver)
        device_end = driver.device
        assert select.select([device_end.fileno()], [], [], PATIENCE_S)[0], "the kernel has it at the other end"
        driver.send(ThrusterCommand(3, True, (1520,) * 6))
        driver.service(now_ns())
        assert list(driver.pwm_us) == [1520] * 6
        driver.close()
