"""`uuv-hil bench startup`, quickly."""

import os
from pathlib import Path

import pytest

from hil.bench import startup_run
from hil.bench.harness import Bench
from hil.bench.limits import Limits
from hil.bench.startup_run import AT_MASTER, Start, coldness, floors, time_floor
from hil.cli import main
from hil.common.errors import NetworkError


def test_phases_follow_each_other() -> None:
    start = Start({"interpreter": 10.0, "imports": 35.0, AT_MASTER: 60.0})
    assert start.phases() == {"interpreter": 10.0, "imports": 25.0, AT_MASTER: 25.0}
    assert start.total == 60.0


def test_a_floor_is_limited_as_the_slave_is() -> None:
    with Bench("paper_field", limits=Limits(cpus=(min(os.sched_getaffinity(0)),))) as bench:
        assert time_floor(bench, "import os; assert len(os.sched_getaffinity(0)) == 1") > 1.0
        with pytest.raises(NetworkError, match="ModuleNotFoundError"):
            time_floor(bench, "import no_such_module")


def test_without_numpy_its_floor_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    assert list(floors()) == ["bare interpreter", "numpy and zenoh"]
    monkeypatch.setattr(startup_run, "find_spec", lambda _: None)
    assert list(floors()) == ["bare interpreter"]


def test_dropping_leaves_files_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / "data"
    path.write_bytes(os.urandom(1 << 16))
    before = path.read_bytes()
    drop, words = coldness([str(path), str(tmp_path / "gone")], whole_machine=False)
    drop()
    assert path.read_bytes() == before
    assert words.startswith("2 files")


def test_what_cannot_be_meant(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "startup", "--repeat", "0"]) == 2
    assert "--repeat" in capsys.readouterr().err
    assert main(["bench", "startup", "--output", "/proc/startup.json"]) == 2
    assert "/proc/startup.json: cannot be written" in capsys.readouterr().err
