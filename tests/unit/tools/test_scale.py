"""Counts of a vehicle's state messages at an observer."""

from hil.client.client import Stamped
from hil.common.clock import NS_PER_MS
from sim.sensors.samples import OdometrySample
from tools.costs.scale import PERIOD_NS, Received


def sample(number: int, age_ns: int = 0) -> Stamped:
    value = OdometrySample(number * PERIOD_NS, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0,) * 6)
    return Stamped(value, 5 * NS_PER_MS, 5 * NS_PER_MS - age_ns)


def test_missing_sequence_numbers_count_as_sent() -> None:
    received = Received()
    assert received.sent() == 0
    for number in (3, 4, 7):
        received.add("odom", sample(number, 2 * NS_PER_MS))
    received.add("imu", sample(99))
    assert received.sent() == 5
    assert received.ages == [2.0, 2.0, 2.0]
    received.clear()
    assert received.sent() == 0
    assert not received.ages
