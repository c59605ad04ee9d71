"""The track file of a run: complete rows, and errors that do not end the flight."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.master.progress import Progress
from hil.master.recorder import COLUMNS, TrackWriter
from hil.recording.recorder import new_folder
from sim.sensors.samples import OdometrySample
from tests.support.processes import ROOT

SAMPLE = OdometrySample(0, (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), (0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
LIMITED = """
import resource, sys
from tests.process.master.test_recorder import fly
resource.setrlimit(resource.RLIMIT_FSIZE, (5000, 5000))
print(*fly(sys.argv[1], 200), sep="\\n")
"""


def fly(folder: str, rows: int) -> list[str]:
    output: list[str] = []
    with TrackWriter(folder, output.append) as track:
        for number in range(rows):
            track.row(number / 20, SAMPLE, SAMPLE, VelocityCommand(surge=0.5))
    return output


def test_each_row_is_written_at_once(tmp_path: Path) -> None:
    with TrackWriter(str(tmp_path)) as track:
        track.row(0.05, SAMPLE, SAMPLE, VelocityCommand(surge=0.5))
        lines = (tmp_path / "track.csv").read_text().splitlines()
    assert lines == [COLUMNS, "0.0500,1.0000,2.0000,3.0000,1.0000,2.0000,3.0000,0.0000,0.5000,0.5000,0.0000"]


def test_a_full_disk_is_reported_once(tmp_path: Path) -> None:
    (tmp_path / "track.csv").symlink_to("/dev/full")
    (line,) = fly(str(tmp_path), 100)
    assert line == f"{tmp_path}/track.csv ends here: No space left on device; the flight goes on"


def test_a_file_of_limited_size_has_complete_rows(tmp_path: Path) -> None:
    command = [sys.executable, "-c", LIMITED, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("File too large") == 1
    text = (tmp_path / "track.csv").read_text()
    assert 4800 < len(text) <= 5000
    assert text.endswith("\n")
    assert {line.count(",") for line in text.splitlines()} == {COLUMNS.count(",")}


def test_runs_in_the_same_second_have_separate_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil.recording.recorder.time.strftime", lambda form: "20260101-120000")
    made = [new_folder("scenarios/reef.toml", str(tmp_path / "runs")) for _ in range(3)]
    assert [os.path.basename(path) for path in made] == [f"reef-20260101-120000{tail}" for tail in ("", "-2", "-3")]
    assert all(os.path.isdir(path) for path in made)


def test_a_log_on_a_full_disk_does_not_end_the_flight(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "master.log"
    log.symlink_to("/dev/full")
    progress = Progress(str(log))
    for number in range(2000):
        progress.print_line(f"line {number} of more than any buffer holds")
    progress.close()
    assert "line 1999" in capsys.readouterr().out
