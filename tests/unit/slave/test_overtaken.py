"""Telemetry that arrives out of order, as on UDP, is neither a restart of the STM32 nor its present state."""

from itertools import pairwise
from typing import Any

import pytest

from hil.common.clock import NS_PER_S, now_ns
from hil.links.contract import ThrusterTelemetry, has_restarted, is_overtaken
from hil.slave.drivers.external import ExternalDriver
from tests.support.links.bench_link import BenchLink, link_with_reports

NEUTRAL, PUSHING, OTHER = (1500,) * 6, (1600,) * 6, (1700,) * 6
STARTED = ThrusterTelemetry(0, False, False, NEUTRAL, 0, 0, 0, 0)


def report(sequence: int, frames: int, pwm_us: tuple[int, ...] = PUSHING, **fields: Any) -> ThrusterTelemetry:
    return ThrusterTelemetry(sequence & 0xFFFF, True, False, pwm_us, 100, frames & 0xFFFF, 0, 0)._replace(**fields)


@pytest.mark.parametrize("begin", [5, 500, 40_000, 65_530])
@pytest.mark.parametrize("sent_before", [0, 3, 40_000])
def test_an_older_report_is_recognised_as_overtaken(begin: int, sent_before: int) -> None:
    """The slave may have sent more commands than the STM32 has counted; both wrap."""
    reports = [report(begin + sent_before + number, begin + number) for number in range(20)]
    for newest, newer in pairwise(reports):
        assert is_overtaken(newest, newer)
        assert not is_overtaken(newer, newest)
        assert not is_overtaken(newer, newer)
        assert not has_restarted(newer, newest)
    lost = report(begin + sent_before + 3000, begin + 2000)
    assert not has_restarted(lost, reports[0]), "some of a minute's commands were lost"
    assert not is_overtaken(lost, reports[0])


@pytest.mark.parametrize("counted", [2, 500, 40_000, 65_000])
def test_a_restart_is_recognised_by_its_counts(counted: int) -> None:
    newest = report(7000, counted)
    assert not is_overtaken(STARTED, newest), "it has counted nothing and is disarmed"
    assert not is_overtaken(report(7001, 1), newest)
    assert has_restarted(report(7001, 1), newest)
    assert not has_restarted(report(7001, 1), STARTED), "it was reported before"


@pytest.mark.parametrize("lead", [0, 3, 40_000])
@pytest.mark.parametrize("counted", [2, 500, 40_000, 65_000])
def test_a_report_before_the_first_command_is_a_restart(counted: int, lead: int) -> None:
    """Its sequence and count begin at 0: the slave has sent as many commands as were counted, or more."""
    newest = report(counted + lead, counted)
    assert has_restarted(STARTED, newest)
    assert not has_restarted(STARTED, STARTED)
    assert not has_restarted(report(counted + lead + 1, 1), STARTED)


def make_driver(received: list[ThrusterTelemetry]) -> ExternalDriver:
    return ExternalDriver(link_with_reports(received), 6, NS_PER_S, print)


def test_the_outputs_are_those_of_the_newest_report() -> None:
    driver = make_driver([report(1, 1, PUSHING), report(3, 3, NEUTRAL), report(2, 2, OTHER), STARTED])
    results = []
    for _ in range(4):
        driver.service(now_ns())
        results.append(tuple(driver.pwm_us))
    assert results == [PUSHING, NEUTRAL, NEUTRAL, NEUTRAL]


def test_an_stm32_that_reports_nothing_for_the_watchdogs_time_counts_as_stopped() -> None:
    link, begin = BenchLink(), 2 * now_ns()
    driver = ExternalDriver(link.bench_ends, 6, NS_PER_S, print)
    assert driver.deadline_ns <= now_ns() + NS_PER_S
    link.reports.append(report(1, 1))
    for after_ns, pulses in ((0, PUSHING), (NS_PER_S, PUSHING), (NS_PER_S + 1, NEUTRAL)):
        driver.service(begin + after_ns)
        assert (driver.pwm_us, driver.deadline_ns) == (pulses, begin + NS_PER_S + (pulses == NEUTRAL) * (NS_PER_S + 1))


def test_a_restart_is_reported_and_late_reports_are_ignored(capsys: pytest.CaptureFixture[str]) -> None:
    late = report(99, 49, timed_out=True)
    tripped = [report(104 + number, 3 + number, timed_out=True) for number in range(2)]
    driver = make_driver([report(100, 50), late, report(101, 51), report(102, 1), report(103, 2), *tripped])
    for _ in range(3):
        driver.service(now_ns())
    assert not capsys.readouterr().out
    for _ in range(2):
        driver.service(now_ns())
    assert capsys.readouterr().out == "the STM32 has restarted\n"
    for _ in tripped:
        driver.service(now_ns())
    assert capsys.readouterr().out == "the STM32's watchdog tripped: thrusters neutral\n"
