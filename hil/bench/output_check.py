"""Turn each output of an STM32 a little, one after the other, and record its telemetry.

All other outputs are neutral meanwhile, and all of them before, between and after: also when it is interrupted or
fails. Only a person can see whether the right thruster turned, and in which direction.
"""

import select
from collections.abc import Callable
from typing import NamedTuple

from hil.common.clock import NS_PER_MS, NS_PER_S, RateKeeper, now_ns, seconds_ns
from hil.common.errors import DeviceError
from hil.links.contract import PWM_NEUTRAL_US, ThrusterCommand, ThrusterTelemetry
from hil.scenario.records import Link
from hil.slave.drivers.driver import ThrusterDriver, open_driver, stop_thrusters

MAX_OFFSET_US = 150  # full thrust is at 400: a check needs no more
RATE_HZ = 50.0
ANSWER_S = 3.0  # for the first report: some bytes after power-up may be lost
PAUSE_S = 0.3  # neutral between two outputs
MORE_S = 1.0  # further time for an output that is not confirmed
WRAP = 0xFFFF  # of sequence numbers
SLACK_US = 2  # protocols that send a fraction change the pulse by rounding


class Plan(NamedTuple):
    """Settings of a check: the STM32 (a kind of hil.slave.drivers.driver), its link, and the pulse.

    offset_us: from neutral, at most +-MAX_OFFSET_US. seconds: for which each output turns. settle: neutral before the
    first, in s, for which speed controllers wait after power-up.
    """

    stm32: str
    link: Link
    channels: int
    offset_us: int
    seconds: float
    settle: float


class Finding(NamedTuple):
    """The telemetry of one output, counted from 1, while it was to turn.

    confirmed_ms: from the first command of the pulse to the report that shows it, None if none did. reported_us: the
    last pulse reported. others: outputs that were reported away from neutral, which they should not be. motor: what
    its controller reported at the end, by unit.
    """

    output: int
    pulse_us: int
    confirmed_ms: float | None
    reported_us: int | None
    others: tuple[int, ...]
    motor: dict[str, float]

    @property
    def passed(self) -> bool:
        """True if the pulse was confirmed, and on this output only."""
        return self.confirmed_ms is not None and not self.others


class StoppedError(Exception):
    """A person has stopped the check, through `stop_fd`."""


def check_outputs(
    plan: Plan, stop_fd: int, report: Callable[[str], None], on_finding: Callable[[Finding], None]
) -> list[Finding] | None:
    """Check all outputs; return the findings, or None if `stop_fd` became readable first.

    `report` gets events of the link, `on_finding` each finding at once. Raises DeviceError when the STM32 does
    not answer or its link is lost; ConfigError, MissingExtraError as `open_driver` does.
    """
    driver = open_driver(plan.stm32, plan.link, plan.channels, True, 1, report)
    check = _Check(plan, driver, stop_fd)
    findings = []
    try:
        check.settle()
        for output in range(plan.channels):
            findings.append(check.turn_output(output))
            on_finding(findings[-1])
    except StoppedError:
        return None
    finally:
        stopped = stop_thrusters(driver, check.sequence + 1)
        driver.close()
        report("all outputs neutral" if stopped else "neutral not confirmed: the STM32's watchdog stops the outputs")
    return findings


class _Check:
    """One run; `sequence` is that of the last command."""

    def __init__(self, plan: Plan, driver: ThrusterDriver, stop_fd: int) -> None:
        self._plan = plan
        self._driver = driver
        self._stop_fd = stop_fd
        self._neutral = (PWM_NEUTRAL_US,) * plan.channels
        self.sequence = 0

    def settle(self) -> None:
        """Command neutral for the plan's time. Raises DeviceError if no report comes, after `ANSWER_S` at least."""
        deadline = now_ns() + seconds_ns(max(self._plan.settle, ANSWER_S))
        while not self._hold(self._neutral, max(self._plan.settle, 0.1)):
            if now_ns() > deadline:
                raise DeviceError(f"{self._driver.port}: {self._why_silent()}; nothing was turned")

    def turn_output(self, output: int) -> Finding:
        """Turn one output for the plan's time, longer if it is not confirmed by then; then neutral for a moment."""
        pulse_us = PWM_NEUTRAL_US + self._plan.offset_us
        pulses = (*self._neutral[:output], pulse_us, *self._neutral[output + 1 :])
        began, confirmed_ns = now_ns(), None
        reported_us: int | None = None
        other_outputs: set[int] = set()
        for seconds in (self._plan.seconds, MORE_S):
            if confirmed_ns is not None:
                break
            for received_ns, telemetry in self._hold(pulses, seconds):
                if not telemetry.armed:
                    reported_us = PWM_NEUTRAL_US
                    continue
                reported_us = telemetry.pwm_us[output]
                if confirmed_ns is None and abs(reported_us - pulse_us) <= SLACK_US:
                    confirmed_ns = received_ns
                moved = enumerate(telemetry.pwm_us)
                other_outputs |= {i + 1 for i, us in moved if i != output and abs(us - PWM_NEUTRAL_US) > SLACK_US}
        host = self._driver.host
        motor = host.protocol.motor_values(output) if host else {}
        self._hold(self._neutral, PAUSE_S)
        confirmed_ms = None if confirmed_ns is None else (confirmed_ns - began) / NS_PER_MS
        return Finding(output + 1, pulse_us, confirmed_ms, reported_us, tuple(sorted(other_outputs)), motor)

    def _hold(self, pulses: tuple[int, ...], seconds: float) -> list[tuple[int, ThrusterTelemetry]]:
        """Command these pulses for that time; return the reports that answer them, and when they came.

        Raises StoppedError, and DeviceError when the link is lost.
        """
        driver, reports, first = self._driver, [], self.sequence + 1
        end = now_ns() + seconds_ns(seconds)
        schedule = RateKeeper(round(NS_PER_S / RATE_HZ), now_ns())
        while (now := now_ns()) < end:
            if schedule.due(now):
                self.sequence += 1
                driver.send(ThrusterCommand(self.sequence & WRAP, True, pulses))
            received = driver.service(now_ns())
            sent = self.sequence + 1 - first
            reports += [(now_ns(), report) for report in received if (report.sequence - first) & WRAP < sent]
            if driver.lost:
                raise DeviceError(f"{driver.port}: the link is lost; the STM32's watchdog stops the outputs")
            wake = min(schedule.deadline_ns, end, driver.deadline_ns)
            wait_s = max(0, wake - now_ns()) / NS_PER_S
            if self._stop_fd in select.select([*driver.descriptors, self._stop_fd], (), (), wait_s)[0]:
                raise StoppedError
        return reports

    def _why_silent(self) -> str:
        """Return possible reasons why the STM32 does not answer."""
        counters = self._driver.host.counters if self._driver.host else None
        if counters is None or not counters.bytes_in:
            return "the STM32 does not answer: check power, wiring (TX to RX), --baud and --protocol"
        return (
            f"{counters.bytes_in} bytes came, but no answer ({counters.checksum_errors} wrong checksums, "
            f"{counters.malformed} malformed): check --channels, --baud, --protocol and --frame"
        )
