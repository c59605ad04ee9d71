"""A flight over a chart, and checks of its report."""

import os
from pathlib import Path

from tests.support.processes import Program, free_port


def check_dive(tmp_path: Path, chart: str) -> None:
    """Fly 5 m over the chart with `uuv-hil demo`; check that its report names the chart and has its pictures."""
    folder = tmp_path / "run"
    listen = f"tcp/127.0.0.1:{free_port()}"
    arguments = ["demo", "--world", chart, "--length", "5", "--output", folder, "--listen", listen]
    with Program(tmp_path, *arguments) as program:
        assert program.wait(240) == 0, program.output
    assert "goal reached" in program.output
    assert f"report of the sensors: {folder}/report.html" in program.output
    report = (folder / "report.html").read_text()
    for name in ("map", "altitude", "camera", "sonar"):
        assert (folder / f"{name}.png").stat().st_size > 10_000
        assert f'src="{name}.png"' in report
    assert os.path.splitext(os.path.basename(chart))[0] in report
    assert ">0 of" not in report, "pictures came"
