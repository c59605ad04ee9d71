"""The live view over a network of 20 Mbit/s, by a relay, as not every kernel has netem."""

from pathlib import Path

import pytest

from hil.common.quantiles import quantile
from tests.support.clients.browser import PATIENCE_MS
from tests.support.clients.view_client import ADDRESS
from tests.support.clients.view_page import steer_by_keyboard, viewed_slave
from tools.costs import view_cost
from tools.faults.relay import Relay

pytest.importorskip("viser", reason="the live view needs the extra view")
pytestmark = pytest.mark.timeout(900)

RATE_MBIT_S = 20.0


def test_the_shown_position_does_not_fall_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three viewers see a seabed of 1,000 x 1,000: a sample is shown soon, and at the end as soon as at the start."""
    monkeypatch.setattr(view_cost, "SLOW_SETTLE_S", 8.0)  # the seabed has gone through by then
    measured = view_cost.measure(tmp_path, 3, 15.0, rate=RATE_MBIT_S)
    third = len(measured.latency_ms) // 3
    begin, end = (quantile(sorted(part), 0.5) for part in (measured.latency_ms[:third], measured.latency_ms[-third:]))
    print(f"{measured.updates_hz:.1f} updates/s, {measured.traffic_mbit_s:.2f} Mbit/s, {begin:.0f} then {end:.0f} ms")
    assert measured.updates_hz > 5.0
    assert 0.0 < measured.traffic_mbit_s < RATE_MBIT_S
    assert begin < view_cost.MAX_LATENCY_MS
    assert end < begin + 300.0, "what is shown falls behind"


def test_a_browser_steers_over_a_slow_network(tmp_path: Path) -> None:
    with viewed_slave(tmp_path) as (page, vehicle, _):
        port = int(page.page.url.partition("//")[2].partition("/")[0].rpartition(":")[2])
        with Relay(port, RATE_MBIT_S * 1e6 / 8, slow=(0,)) as relay:
            found = page.view.expect(ADDRESS)
            page.page.goto(f"http://127.0.0.1:{relay.port}/?token={found[2]}", timeout=PATIENCE_MS)
            page.wait_until_ready()
            page.wait_until_drawn()
            steer_by_keyboard(page, vehicle)
            assert relay.passed > 100_000, "the page came another way"
