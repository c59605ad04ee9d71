"""Cost of many slaves for a machine and its routers: rows of `tools/costs/scale.py`, by real processes."""

import pytest

from tools.costs.scale import HEADER, measure


@pytest.mark.parametrize("sessions", ["one", "each"])
def test_two_slaves_are_seen_through_two_routers(sessions: str) -> None:
    cells = measure(2, 2, 3.0, sessions, step=2.5).split("|")[1:-1]
    row = dict(zip((name.strip() for name in HEADER.split("|")[1:-1]), map(str.strip, cells), strict=True))
    assert (row["slaves"], row["routers"], row["sessions"], row["found"]) == ("2", "2", sessions, "2")
    assert 0.0 < float(row["state, Hz each"]) < 40.0
    assert 0.0 <= float(row["lost, %"]) < 100.0
    assert float(row["age 99 %, ms"]) > 0.0
    assert float(row["age 50 %, ms"]) <= float(row["age 99 %, ms"])
    assert float(row["RSS a slave, MiB"]) > 10.0
