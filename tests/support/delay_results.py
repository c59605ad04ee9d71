"""Invented results of delay runs for tests."""

from collections.abc import Mapping
from typing import Any

from hil.bench.delay_run import HOPS, Result
from hil.client.delay import DelayMeter
from hil.links.address import wire_kind
from hil.ros.diagnostics import Diagnostics
from tests.support.diagnostics import reported

MS = 1_000_000


def meter(
    offset: int, same_clock: bool, network: int = MS // 2, count: int = 60, return_delay: int = MS // 2
) -> DelayMeter:
    """Return a meter with commands to a slave whose clock is `offset` ns ahead."""
    delay_meter = DelayMeter()
    delay_meter.same_clock = same_clock
    for number in range(count):
        published = number * 50 * MS
        received = published + network + offset
        taken, computed, written, applied = (received + us * 1000 for us in (20, 100, 150, 160))
        sent = applied + 20_000
        instants = [number, published, received, taken, written, applied, computed]
        delay_meter.add(instants, sent, sent - offset + return_delay)
    return delay_meter


def some_result(delay: list[float], found: Mapping[str, list[float]] = {}, **changes: Any) -> Result:
    """Return a run at 20 Hz that found these delays and other values (ms), its floor 0.05 ms."""
    values = {"delay": delay, "motion": [4.0] * 9, "udp floor": [0.06] * 9, "tcp floor": [0.05] * 9}
    values |= {f"hop {name}": [value / len(HOPS) for value in delay] for name in HOPS}
    return Result({**values, **found}, 0.0, len(delay), 20.0, 0.0, 0.0, [])._replace(**changes)


def on(port: str) -> Diagnostics:
    """Return the diagnostics of a slave whose link is present."""
    return reported(link_port=port, link_wire=wire_kind(port))
