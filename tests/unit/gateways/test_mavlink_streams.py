"""Rates of MAVLink messages: what each request sets, within which limits, and which messages are due."""

from math import nan

import pytest

from hil.common.clock import NS_PER_MS
from hil.gateways.mavlink.protocols.streams import STREAMS, StreamRates, number_of

ATTITUDE, VFR_HUD, ALTITUDE = number_of("ATTITUDE"), number_of("VFR_HUD"), number_of("ALTITUDE")


@pytest.mark.parametrize(
    ("asked_us", "interval_us"),
    [(250_000, 250_000), (1, 20_000), (20_000, 20_000), (1e9, 20_000_000), (9.9e11, 20_000_000), (-1, -1), (-5, -1),
     (0, 100_000), (nan, None), (1e12, None), (-1e12, None)],
)  # fmt: skip
def test_an_interval_is_set_within_the_limits(asked_us: float, interval_us: int | None) -> None:
    rates = StreamRates()
    rates.set_interval(ATTITUDE, 500_000)
    assert rates.set_interval(ATTITUDE, asked_us) == (interval_us is not None)
    assert rates.interval_us(ATTITUDE) == (interval_us or 500_000)
    assert (rates.set_interval(999, 1000), rates.interval_us(999), rates.interval_us(ALTITUDE)) == (False, 0, -1)


@pytest.mark.parametrize(
    ("group", "rate", "start", "hud_us", "attitude_us"),
    [(0, 5, True, 200_000, 200_000), (11, 5, True, 200_000, 100_000), (11, 0, True, -1, 100_000),
     (11, 5, False, -1, 100_000), (10, 99, True, 250_000, 20_000), (99, 5, True, 250_000, 100_000)],
)  # fmt: skip
def test_a_group_has_one_rate(group: int, rate: int, start: bool, hud_us: int, attitude_us: int) -> None:
    rates = StreamRates()
    assert rates.set_group(group, rate, start) == (group != 99)
    assert (rates.interval_us(VFR_HUD), rates.interval_us(ATTITUDE)) == (hud_us, attitude_us)
    assert rates.interval_us(number_of("HEARTBEAT")) == 1_000_000
    assert rates.interval_us(ALTITUDE) == -1


def test_a_message_that_is_late_is_sent_once_and_one_that_is_set_again_at_once() -> None:
    rates = StreamRates()
    for name in STREAMS:
        rates.set_interval(number_of(name), -1 if name != "ATTITUDE" else 100_000)
    due = [now_ms for now_ms in (0, 99, 100, 250, 299, 300, 500, 599, 600) if rates.due(now_ms * NS_PER_MS)]
    assert due == [0, 100, 250, 300, 500, 600]
    rates.set_interval(ATTITUDE, 100_000)
    assert rates.due(601 * NS_PER_MS) == [ATTITUDE]
    rates.set_group(10, 10, True)
    assert ATTITUDE in rates.due(602 * NS_PER_MS)
