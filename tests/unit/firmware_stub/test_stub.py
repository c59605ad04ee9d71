"""The STM32's behaviour, by a clock of integers."""

import pytest

from firmware_stub.stub import LATE_WINDOW, NEVER_US, Stm32
from hil.links.contract import ThrusterCommand

MS = 1_000_000
FULL = (1900, 1100)
NEUTRAL = [1500, 1500]


def armed(sequence: int, pwm_us: tuple[int, ...] = FULL) -> ThrusterCommand:
    return ThrusterCommand(sequence, True, pwm_us)


@pytest.fixture
def stm32() -> Stm32:
    return Stm32(2, watchdog_ns=200 * MS, telemetry_period_ns=20 * MS)


def test_the_stm32_starts_neutral_and_disarmed(stm32: Stm32) -> None:
    assert stm32.pwm_us == NEUTRAL
    report = stm32.telemetry(0)
    assert (report.armed, report.timed_out, report.frames, report.age_us) == (False, False, 0, NEVER_US)


def test_outputs_follow_only_while_armed(stm32: Stm32) -> None:
    assert stm32.command(ThrusterCommand(1, False, FULL), 0)
    assert stm32.pwm_us == NEUTRAL
    assert stm32.command(armed(2), 1)
    assert stm32.pwm_us == list(FULL)
    assert stm32.command(ThrusterCommand(3, False, FULL), 2)
    assert stm32.pwm_us == NEUTRAL
    assert not stm32.armed


@pytest.mark.parametrize(
    ("requested", "pulse"), [(800, 800), (2200, 2200), (799, 0), (2201, 0), (0, 0), (65535, 0), (1500, 1500)]
)
def test_a_pulse_width_out_of_range_gives_no_pulse(stm32: Stm32, requested: int, pulse: int) -> None:
    stm32.command(armed(1, (requested, 1500)), 0)
    assert stm32.pwm_us == [pulse, 1500]


@pytest.mark.parametrize("pwm_us", [(), (1600,), (1600, 1600, 1600)])
def test_a_wrong_number_of_channels_is_refused(stm32: Stm32, pwm_us: tuple[int, ...]) -> None:
    stm32.command(armed(1), 0)
    assert not stm32.command(armed(2, pwm_us), 150 * MS)
    assert stm32.pwm_us == list(FULL)
    assert (stm32.frames, stm32.refused, stm32.sequence) == (1, 1, 1)
    stm32.tick(200 * MS)
    assert stm32.timed_out, "a refused command does not reset the watchdog"


def test_the_watchdog_trips_exactly_at_its_timeout_and_once(stm32: Stm32) -> None:
    stm32.command(armed(1), 1000)
    stm32.tick(1000 + 200 * MS - 1)
    stm32.telemetry(1000 + 200 * MS - 1)
    assert stm32.pwm_us == list(FULL)
    assert stm32.tick(1000 + 200 * MS), "a trip is reported at once"
    report = stm32.telemetry(1000 + 200 * MS)
    assert report.pwm_us == (1500, 1500)
    assert (report.timed_out, report.armed, report.watchdog_trips, report.sequence) == (True, False, 1, 1)
    for now in range(300 * MS, 3000 * MS, 100 * MS):
        stm32.tick(now)
    assert stm32.watchdog_trips == 1


def test_every_command_resets_the_watchdog(stm32: Stm32) -> None:
    for sequence in range(100):
        now = sequence * 199 * MS
        stm32.tick(now)
        stm32.command(armed(sequence), now)
    assert stm32.watchdog_trips == 0
    stm32.tick(99 * 199 * MS + 200 * MS)
    assert stm32.watchdog_trips == 1


def test_the_watchdog_also_trips_while_disarmed(stm32: Stm32) -> None:
    stm32.command(ThrusterCommand(1, False, FULL), 0)
    stm32.tick(200 * MS)
    assert stm32.timed_out


def test_without_a_first_command_there_is_no_timeout(stm32: Stm32) -> None:
    stm32.tick(10_000 * MS)
    assert not stm32.timed_out


def test_any_sequence_number_is_accepted_after_a_trip(stm32: Stm32) -> None:
    stm32.command(armed(500), 0)
    stm32.tick(200 * MS)
    assert stm32.command(armed(499), 300 * MS), "after a trip every sequence number is accepted"
    report = stm32.telemetry(300 * MS)
    assert (report.timed_out, report.armed, report.watchdog_trips, report.pwm_us) == (False, True, 1, FULL)
    stm32.tick(500 * MS)
    assert stm32.watchdog_trips == 2


@pytest.mark.parametrize(
    ("last", "sequence", "applied"),
    [
        (100, 101, True),
        (100, 100, True),  # the same again
        (100, 99, False),  # overtaken
        (100, 100 - LATE_WINDOW, False),
        (100, 99 - LATE_WINDOW, True),  # the host started again
        (100, 40_000, True),
        (65535, 0, True),
        (0, 65535, False),
        (255, 0, True),  # a frame whose sequence has eight bits
    ],
)
def test_commands_with_older_sequence_numbers_are_refused(
    stm32: Stm32, last: int, sequence: int, applied: bool
) -> None:
    stm32.command(armed(last), 0)
    assert stm32.command(armed(sequence, (1700, 1700)), 1) == applied
    assert stm32.pwm_us == ([1700, 1700] if applied else list(FULL))
    assert stm32.sequence == (sequence if applied else last)
    assert stm32.refused == (not applied)


def test_commands_with_a_constant_sequence_number_are_executed(stm32: Stm32) -> None:
    for width in range(1500, 1600):
        assert stm32.command(armed(0, (width, width)), width * MS)
        stm32.tick(width * MS)
        assert stm32.pwm_us == [width, width]
    assert stm32.watchdog_trips == 0


def test_the_reported_age_counts_from_the_command(stm32: Stm32) -> None:
    stm32.command(armed(1), 5 * MS)
    assert stm32.telemetry(5 * MS).age_us == 0
    assert stm32.telemetry(5 * MS + 1_234_567).age_us == 1234
    assert stm32.telemetry(10**17).age_us == NEVER_US


def test_counters_wrap_at_sixteen_bits(stm32: Stm32) -> None:
    stm32.frames, stm32.refused, stm32.line_errors, stm32.watchdog_trips = 65536 + 5, 65535, 3, 65537
    report = stm32.telemetry(0)
    assert (report.frames, report.errors, report.watchdog_trips) == (5, 2, 1)


def test_telemetry_keeps_its_period_without_drift(stm32: Stm32) -> None:
    sent = []
    for now in range(0, 1000 * MS, 300_000):  # a loop that never runs at the exact time
        if stm32.tick(now):
            stm32.telemetry(now)
            sent.append(now)
    assert len(sent) == 50
    assert all(i * 20 * MS <= now < i * 20 * MS + 300_000 for i, now in enumerate(sent))


def test_missed_telemetry_periods_are_skipped(stm32: Stm32) -> None:
    stm32.tick(0)
    stm32.telemetry(0)
    assert stm32.tick(95 * MS)
    stm32.telemetry(95 * MS)
    assert not stm32.tick(95 * MS)
    assert stm32.deadline_ns == 115 * MS


def test_a_reply_postpones_the_next_report(stm32: Stm32) -> None:
    stm32.telemetry(0)
    stm32.command(armed(1), 15 * MS)
    stm32.telemetry(15 * MS)
    assert not stm32.tick(34 * MS)
    assert stm32.tick(35 * MS)


def test_the_deadline_is_the_earlier_of_telemetry_and_watchdog() -> None:
    stm32 = Stm32(2, watchdog_ns=30 * MS, telemetry_period_ns=20 * MS)
    assert stm32.deadline_ns == 0
    stm32.telemetry(0)
    assert stm32.deadline_ns == 20 * MS
    stm32.command(armed(1), 5 * MS)
    stm32.telemetry(20 * MS)
    assert stm32.deadline_ns == 35 * MS
    stm32.tick(35 * MS)
    stm32.telemetry(35 * MS)
    assert stm32.deadline_ns == 55 * MS, "a tripped watchdog has no deadline"
