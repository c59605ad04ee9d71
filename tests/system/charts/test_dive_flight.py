"""A flight over a small chart, with slave and planner as processes."""

from pathlib import Path

import pytest

from tests.support.charts.dive import check_dive
from tests.support.charts.small_cell import bay


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def test_a_short_flight_over_a_small_chart(tmp_path: Path) -> None:
    check_dive(tmp_path, bay().write(tmp_path / "BAY.000"))
