"""`uuv-hil bench startup`: its phases and floors, without long measurements."""

import os
from pathlib import Path

import pytest

from hil.bench.harness import Bench
from hil.bench.startup_run import AT_MASTER, drop, phases, time_floor
from hil.common.errors import NetworkError


def test_phases_are_differences_of_consecutive_times() -> None:
    ends = {"interpreter": 10.0, "imports": 35.0, AT_MASTER: 60.0}
    assert phases(ends) == {"interpreter": 10.0, "imports": 25.0, AT_MASTER: 25.0}


def test_the_floor_is_run_by_the_command_that_runs_the_slave() -> None:
    with Bench("paper_field", under=["taskset", "-c", str(min(os.sched_getaffinity(0)))]) as bench:
        assert time_floor(bench, "import os; assert len(os.sched_getaffinity(0)) == 1") > 1.0
        with pytest.raises(NetworkError, match="ModuleNotFoundError"):
            time_floor(bench, "import no_such_module")


def test_dropping_files_from_the_page_cache_leaves_their_content(tmp_path: Path) -> None:
    path = tmp_path / "data"
    path.write_bytes(os.urandom(1 << 16))
    before = path.read_bytes()
    drop([str(path), str(tmp_path / "gone")])
    assert path.read_bytes() == before
