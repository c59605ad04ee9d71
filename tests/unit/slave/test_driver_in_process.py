"""Time at which an STM32 in the slave's own process applied a command."""

import time

import pytest

from hil.common.clock import now_ns
from hil.links.contract import ThrusterCommand
from hil.scenario.config import load_scenario
from hil.slave.drivers.driver import open_driver
from tests.support.links.link_contract import await_answer, nothing_leaks


@pytest.mark.parametrize("kind", ["python", "unicorn"])
def test_the_applied_time_includes_reading_and_executing_the_command(kind: str) -> None:
    """The outputs did not have the pulses before these were read, however old the caller's time is."""
    with nothing_leaks():
        driver = open_driver(kind, load_scenario("paper_field").link, 6, True, 1, lambda _: None)
        for sequence in range(1, 6):
            stale = now_ns()
            time.sleep(0.002)
            driver.send(ThrusterCommand(sequence, True, (1500 + sequence,) * 6))
            sent = now_ns()
            answers = await_answer(driver, sequence)
            assert answers, "it is answered"
            assert sent < driver.applied_ns(answers[0], stale) <= now_ns()
        driver.close()
