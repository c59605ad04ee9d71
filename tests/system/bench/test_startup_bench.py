"""`uuv-hil bench startup` with one start of each kind."""

import json
from pathlib import Path

import pytest

from hil.bench.startup_run import AT_MASTER, PHASES, floors
from hil.cli import main


def test_one_quick_run_has_all_phases(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "startup.json"
    assert main(["bench", "startup", "--repeat", "1", "--output", str(path)]) == 0
    assert "cold: pages that a running process" in capsys.readouterr().out.replace("\n", " ")
    record = json.loads(path.read_text())
    for kind in ("warm", "cold"):
        figures = {
            name: record["figures"][f"{name} [{kind}]"]["median"] for name in (*PHASES.values(), AT_MASTER, "all")
        }
        assert sum(figures.values()) == pytest.approx(2 * figures["all"])
        assert figures["interpreter"] > 1.0
        assert figures[AT_MASTER] > 45.0, "odometry is measured 20 times a second: not the IMU's first sample"
        assert record["figures"][f"bare interpreter [{kind}]"]["median"] < figures["all"]
        assert all(f"{name} [{kind}]" in record["figures"] for name in floors())
