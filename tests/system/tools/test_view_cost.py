"""The tool that measures the cost of the live view: figures for each number of viewers."""

import sys

import pytest

from tools.costs import view_cost


def test_each_number_of_viewers_is_measured(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["view_cost.py", "--seconds", "2"])
    monkeypatch.setattr(view_cost, "SETTLE_S", 1.0)
    monkeypatch.setattr(view_cost, "MAX_LATENCY_MS", 1e4)  # this machine may be busy
    assert view_cost.main() == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[1:]]
    assert [row[0] for row in rows] == ["no", "0", "1", "10"], rows
    assert [float(row[-2]) > 0.0 for row in rows] == [False, False, True, True]
    for row in rows[2:]:
        assert 0.0 < float(row[-4]) <= float(row[-3])
