"""Instruments after a loss of power and after noise on their wires."""

import pytest

from tools.faults.instruments import run_instruments


@pytest.mark.parametrize("fault", ["power cycle", "garbage to the instrument"])
def test_instruments_recover(fault: str) -> None:
    """One on each kind of wire; the campaign of tools.faults has all of them, and the other faults."""
    names = ("waterlinked_a50", "ping2", "waterlinked_ugps", "ublox_m9")
    rows = list(run_instruments(lambda row: row in [f"instrument {fault} {name}" for name in names]))
    assert len(rows) == len(names)
    assert not [row for row in rows if not row.passed]
