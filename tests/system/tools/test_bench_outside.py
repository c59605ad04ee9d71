"""The comparison of benchmark figures with independent tools runs and finds no large difference."""

import os

import pytest

from tools.costs import bench_outside

SECONDS = 2.0


@pytest.mark.skipif(os.geteuid() != 0, reason="only root sees packets and executions")
def test_figures_agree_with_those_of_independent_tools(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil.bench.table.run.BARE_S", 0.2)
    rows = [*bench_outside.mission(SECONDS), *bench_outside.commands(SECONDS)]
    assert [row.name for row in rows] == [
        "start-up", "ready", "slave memory", "slave memory", "slave memory, alone", "slave CPU", "master CPU",
        "command delay p50", "slave CPU, in all",
    ]  # fmt: skip
    for row in rows:
        exact = row.unit in ("s", "MiB")  # the others are over other parts of so short a flight
        assert abs(row.off) < (0.25 if exact else 1.0), row
