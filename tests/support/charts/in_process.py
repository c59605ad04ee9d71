"""Fixtures: charts are read and gridded in the test's process, or in the one that does it otherwise.

A process of its own would load GDAL and SciPy for each chart.
"""

import warnings
from collections.abc import Callable
from importlib import import_module
from typing import Any

import pytest

from hil.charts import limited


@pytest.fixture
def own_process() -> None:
    """Let charts be read in processes of their own, for files that may end them."""


@pytest.fixture
def charts_in_process(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Read and grid charts in this process, unless the test asks for `own_process`."""
    if "own_process" not in request.fixturenames:
        monkeypatch.setattr(limited, "call", _call_here)


def _call_here(
    function: str, *arguments: Any, limits: limited.Limits, report: Callable[[Any], None] | None = None
) -> Any:
    module, _, name = function.partition(":")
    program = import_module(module)
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("default")  # as in a process of its own
        patch.setattr(program, "limit_self", lambda *_: None, raising=False)
        return getattr(program, name)(*arguments, **({"report": report} if report else {}))
