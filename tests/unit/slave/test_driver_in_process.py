"""Time at which an STM32 in the slave's own process applied a command."""

import time
from contextlib import nullcontext
from typing import Any

import pytest

from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import ConfigError
from hil.links.contract import ThrusterCommand
from hil.scenario.config import load_scenario
from hil.slave.drivers.driver import open_driver
from hil.slave.drivers.ends import check_line_rate, end_protocol, host_end, with_faults
from tests.support.links.bench_link import BenchLink
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
            assert driver.applied_ns(answers[0]._replace(age_us=10**7), stale) < sent - 9 * NS_PER_S, "a later one"
        driver.close()


def test_the_ends_of_a_link_have_its_options_and_faults_or_none() -> None:
    bench = BenchLink()
    wire: Any = bench
    link = load_scenario("paper_field").link
    with pytest.raises(ConfigError, match=r"link: options: colour, size: .*frame"):
        end_protocol(link._replace(options={"colour": 1, "size": 2}), "host", 6)
    assert with_faults(wire, link, 1) is wire
    with pytest.raises(ConfigError):
        host_end(wire, link._replace(protocol="no_such"), 6, 1)
    assert bench.closed, "an end that is not made holds no device"


@pytest.mark.parametrize(
    ("port", "baud", "fits"), [("/dev/x", 1200, False), ("/dev/x", 115_200, True), ("pty:", 1200, True)]
)
def test_a_line_too_slow_for_the_commands_is_refused(port: str, baud: int, fits: bool) -> None:
    link = load_scenario("paper_field").link._replace(port=port, baud=baud)
    with nullcontext() if fits else pytest.raises(ConfigError, match="link: baud: "):
        check_line_rate(link, 6, 50.0)
