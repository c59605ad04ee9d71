"""Conformance tests of every STM32, real or emulated, over any protocol. A kind subclasses `Stm32Contract`."""

import select
from collections.abc import Iterator
from itertools import islice
from typing import ClassVar

import pytest

from hil.common.clock import NS_PER_S, now_ns
from hil.links.contract import ThrusterCommand, ThrusterTelemetry
from hil.scenario.records import Link
from hil.slave.drivers.driver import ThrusterDriver, open_driver, stop_thrusters
from tests.support.links.link_contract import nothing_leaks

NEUTRAL = (1500,) * 6
PATIENCE_NS = 30 * NS_PER_S
WATCHDOG_S = 0.2
SLACK_S = 3.0  # a busy machine wakes processes late; unit tests check the time itself


class Stm32Contract:
    """The contract of an STM32: subclass it as `Test...` with its `kind` and `link`."""

    kind: ClassVar[str]
    link: ClassVar[Link] = Link(watchdog=WATCHDOG_S)
    reports_time_out: ClassVar[bool] = True  # VESC's status has no word for it

    @pytest.fixture
    def driver(self) -> Iterator[ThrusterDriver]:
        """Provide a new driver that has received a report."""
        reports: list[str] = []
        with nothing_leaks():
            driver = open_driver(self.kind, self.link, 6, True, 1, reports.append)
            self.sequence = 0
            try:
                self.command(driver, False, NEUTRAL)
                yield driver
            finally:
                driver.close()
        # A process that got no turn; some tests stop the commands.
        late = ("has not answered for", "the STM32 answers, after", "watchdog tripped")
        assert [report for report in reports if not any(words in report for words in late)] == []

    def command(self, driver: ThrusterDriver, armed: bool, pulses: tuple[int, ...]) -> ThrusterTelemetry:
        """Send a command until a report shows it: some of the first bytes after power-up may be lost."""
        deadline = now_ns() + PATIENCE_NS
        expected, wait_s = pulses if armed else NEUTRAL, 0.05
        while now_ns() < deadline:
            self.sequence += 1
            driver.send(ThrusterCommand(self.sequence, armed, pulses))
            wait_s *= 1.2  # it may answer late, where others use the machine too
            for telemetry in self.listen(driver, wait_s):
                if telemetry.pwm_us == expected and telemetry.armed == armed and telemetry.sequence == self.sequence:
                    return telemetry
        pytest.fail(f"no answer that shows {expected}; the thrusters have {driver.pwm_us}")

    def listen(self, driver: ThrusterDriver, seconds: float) -> Iterator[ThrusterTelemetry]:
        """Return the reports of the next `seconds`, without a command."""
        end = now_ns() + round(seconds * NS_PER_S)
        while (now := now_ns()) < end:
            wait_ns = max(0, min(end, driver.deadline_ns) - now)
            select.select(driver.descriptors, (), (), wait_ns / NS_PER_S)
            yield from driver.service(now_ns())

    def test_outputs_follow_commands(self, driver: ThrusterDriver) -> None:
        for pulses in ((1600, 1400, 1500, 1555, 1445, 1501), (1100, 1900, 1500, 1500, 1500, 1500)):
            telemetry = self.command(driver, True, pulses)
            assert telemetry.pwm_us == pulses
            assert tuple(driver.pwm_us) == pulses
            assert not telemetry.timed_out
        before = now_ns()
        assert before - NS_PER_S < driver.applied_ns(telemetry, before) <= before

    def test_disarmed_outputs_are_neutral(self, driver: ThrusterDriver) -> None:
        self.command(driver, True, (1700,) * 6)
        self.command(driver, False, (1700,) * 6)
        assert tuple(driver.pwm_us) == NEUTRAL

    def test_outputs_are_neutral_after_the_watchdog_timeout(self, driver: ThrusterDriver) -> None:
        self.command(driver, True, (1700,) * 6)
        silent = now_ns()
        neutral = next(t for t in self.listen(driver, PATIENCE_NS / NS_PER_S) if t.pwm_us == NEUTRAL)
        assert now_ns() - silent < (WATCHDOG_S + SLACK_S) * NS_PER_S
        assert tuple(driver.pwm_us) == NEUTRAL
        assert neutral.timed_out or not self.reports_time_out
        self.command(driver, True, (1650,) * 6)  # and the next command ends it
        assert tuple(driver.pwm_us) == (1650,) * 6

    def test_noise_moves_nothing(self, driver: ThrusterDriver) -> None:
        """Noise comes between two commands; each link counts it in its own way."""
        assert driver.host is not None
        self.command(driver, True, (1612,) * 6)
        noise = bytes(range(256))
        if self.link.protocol in ("dronecan", "vesc"):  # a bus: frames of others
            noise = b"".join((0x700 + i).to_bytes(4, "little") + bytes([8, 0, 0, 0]) + bytes(8) for i in range(8))
        driver.host.wire.write(noise)
        for telemetry in self.listen(driver, 0.1):
            assert telemetry.pwm_us in ((1612,) * 6, NEUTRAL)
        self.command(driver, True, (1613,) * 6)

    def test_reports_are_sent_without_commands(self, driver: ThrusterDriver) -> None:
        """The STM32 reports without a request."""
        assert len(list(islice(self.listen(driver, PATIENCE_NS / NS_PER_S), 3))) == 3

    def test_closing_leaves_the_thrusters_neutral(self, driver: ThrusterDriver) -> None:
        self.command(driver, True, (1700,) * 6)
        assert stop_thrusters(driver, self.sequence + 1)
        assert tuple(driver.pwm_us) == NEUTRAL
