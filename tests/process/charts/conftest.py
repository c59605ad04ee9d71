"""Charts are read in the test's process, unless a test is about the process that does it otherwise."""

import pytest

from tests.support.charts.in_process import charts_in_process, own_process  # noqa: F401


@pytest.fixture(autouse=True)
def _in_this_process(charts_in_process: None) -> None:  # noqa: F811
    pass
