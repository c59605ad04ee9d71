"""`tools/costs/scale.py`: the cost of many slaves and routers on one machine, with real processes."""

from contextlib import ExitStack
from pathlib import Path

import psutil
import pytest

from tests.support.processes import command_line, wait_for
from tools.costs.scale import BROKEN, HEADER, main, measure


@pytest.mark.parametrize("sessions", ["one", "each"])
def test_two_slaves_are_discovered_through_two_routers(sessions: str, tmp_path: Path) -> None:
    with ExitStack() as stack:
        cells = measure(stack, tmp_path, 2, 2, 3.0, sessions, step=2.5).split("|")[1:-1]
    row = dict(zip((name.strip() for name in HEADER.split("|")[1:-1]), map(str.strip, cells), strict=True))
    assert (row["slaves"], row["routers"], row["sessions"], row["found"]) == ("2", "2", sessions, "2")
    assert 0.0 < float(row["state, Hz each"]) < 40.0
    assert 0.0 <= float(row["lost, %"]) < 100.0
    assert float(row["age 99 %, ms"]) > 0.0
    assert float(row["age 50 %, ms"]) <= float(row["age 99 %, ms"])
    assert float(row["RSS a slave, MiB"]) > 10.0


def test_a_run_that_fails_is_a_row_and_leaves_no_process(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The run takes longer than its limit. Slaves are recognised by the folder of their scenarios."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert main(["--slaves", "3", "--routers", "2", "--limit", "3"]) == 0
    output = capsys.readouterr().out
    assert BROKEN in output
    assert "| 3 | 2 | 2.5 ms | no result within 3 s |" in output
    assert not list(tmp_path.iterdir())
    assert wait_for(lambda: not [pid for pid in psutil.pids() if str(tmp_path) in command_line(pid)])


def test_slaves_that_do_not_start_are_counted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tools.costs.scale.SCENARIO", "{number}{router}{step}")
    monkeypatch.setattr("tools.costs.scale.START_WITHIN_S", 2.0)
    with ExitStack() as stack:
        row = measure(stack, tmp_path, 2, 1, 1.0, "one", step=10.0)
    assert row.startswith("| 2 | 1 | 10 ms | 0 began, ")
