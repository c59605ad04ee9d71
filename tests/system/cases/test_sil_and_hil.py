"""A short flight in simulated time and with a slave as a process, and the report of both."""

import math
from pathlib import Path

from hil.cases import fidelity
from hil.cases.path_planning import PathPlanning
from hil.cases.report import write_report
from hil.scenario.variant import write_variant


def test_sil_and_hil_flights_agree_and_are_reported(tmp_path: Path) -> None:
    """The slave is a process with an emulated STM32."""
    short = write_variant("path_planning", str(tmp_path), {"master.goal": [3.5, -1.0], "start.heading": -0.3})
    case = PathPlanning("path_planning")
    case.scenario = short
    runs = []
    for mode in ("sil", "hil"):
        folder = tmp_path / mode
        folder.mkdir()
        runs.append(case.fly(mode, 1, str(folder)))
    sil, hil = (run.result for run in runs)
    assert sil.success
    assert hil.success, hil.reason
    assert 0.0 < hil.master_cpu < 0.5
    assert 0.0 < hil.delay_p50 <= hil.delay_p99
    assert math.isnan(sil.delay_p50)
    _, greatest, _, time, *_ = fidelity.compare(*runs)
    assert greatest < 0.3
    assert abs(time) < 0.15
    assert "thrusters neutral" in (tmp_path / "hil" / "slave1.log").read_text()
    files = write_report(str(tmp_path / "report.md"), {"path_planning": runs}, str(tmp_path / "pictures_of_it"))
    assert all(Path(file).stat().st_size > 1000 for file in files)
    text = Path(files[0]).read_text()
    for words in ("**The paper.** Figures 8 and 9", "| seed 1 | SIL | HIL |", "(pictures_of_it/path_planning.png)"):
        assert words in text
