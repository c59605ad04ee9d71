"""Delay by hop, and the offset between two clocks."""

import random
import tracemalloc

import pytest

from hil.client.delay import DelayMeter, quantiles

MS = 1_000_000


def trace(sequence: int, published: int, network: int, offset: int) -> list[int]:
    received = published + network + offset
    return [sequence, published, received, received + 20_000, received + 100_000, received + 300_000, received + 50_000]


def test_delays_by_one_clock_are_split_into_hops() -> None:
    meter = DelayMeter()
    meter.add(trace(1, 1000 * MS, 200_000, 0), sent_ns=1001 * MS, received_ns=1002 * MS)
    assert meter.totals_ns() == [500_000]
    assert [meter.hop_ns(hop) for hop in range(5)] == [[200_000], [20_000], [30_000], [50_000], [200_000]]
    assert meter.offset_ns() == (0, 0)


@pytest.mark.parametrize("offset", [0, 5_000 * MS, -90_000 * MS])
def test_two_clocks_are_distinguished_from_delay(offset: int) -> None:
    generator = random.Random(1)
    meter = DelayMeter()
    meter.same_clock = False
    for number in range(200):
        published = number * 50 * MS
        there, back = (round(generator.expovariate(1 / (2 * MS))) + 300_000 for _ in range(2))
        sent = published + there + offset + 400_000
        meter.add(trace(number, published, there, offset), sent, sent - offset + back)
    found, uncertainty = meter.offset_ns()
    assert abs(found - offset) <= uncertainty < 1 * MS
    assert 0 < quantiles(meter.totals_ns()).p50_ms < 10


def test_only_the_newest_samples_are_stored() -> None:
    meter, unlimited = DelayMeter(min_commands=10), DelayMeter(min_commands=0)
    for number in range(1005):
        for one in (meter, unlimited):
            one.add(trace(number, number * MS, 200_000 + number, 0), (number + 1) * MS, (number + 2) * MS)
    assert len(meter) == len(unlimited) == 1005
    assert 10 <= meter.stored < 20
    assert meter.samples() == unlimited.samples(meter.stored)


def test_many_commands_take_as_much_memory_as_some() -> None:
    meter, sizes = DelayMeter(min_commands=1000), []
    tracemalloc.start()
    try:
        for number in range(6000):
            meter.add(trace(number, number * 50 * MS, 200_000, 0), number * 50 * MS + MS, number * 50 * MS + 2 * MS)
            if number % 2000 == 1999:
                sizes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert max(sizes) - sizes[0] < 1 << 15
    assert len(meter) == 6000


def test_malformed_traces_are_counted() -> None:
    meter = DelayMeter()
    meter.add([1, 2, 3], 0, 0)
    meter.add([0, -(1 << 63), (1 << 63) - 1, 0, 0, 0, 0], 0, 0)
    assert meter.malformed == 2
    meter.add(trace(1, 0, 200_000, 0), 3600_000 * MS, 3600_000 * MS)  # the vehicle's clock was set meanwhile
    meter.add(trace(2, 3600_000 * MS, 200_000, 0), 3600_001 * MS, 2 * MS)  # ours was set back
    assert meter.malformed == 4
    assert len(meter) == 0
