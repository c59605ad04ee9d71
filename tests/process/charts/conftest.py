"""Charts are read and gridded in the test's process, unless a test is about the process that does it otherwise."""

import pytest

from hil.charts import build_process
from hil.charts.imports import meshes
from hil.charts.sources import s57
from tests.support.charts.in_process import finish_here, start_here


@pytest.fixture
def own_process() -> None:
    """Let charts be read in processes of their own, for files that may end them."""


@pytest.fixture(autouse=True)
def _in_this_process(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if "own_process" not in request.fixturenames:
        monkeypatch.setattr(build_process, "start_child", start_here)
        monkeypatch.setattr(meshes, "start_child", start_here)
        monkeypatch.setattr(s57, "finish_child", finish_here)
