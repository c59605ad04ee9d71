"""Ends of campaigns and cases by signals: both commands that start workers, and each signal that ends them."""

import signal
from pathlib import Path

import pytest

from tests.process.commands.test_campaign import check_workers_end


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
@pytest.mark.parametrize("name", ["campaign", "case"])
def test_no_worker_outlives_it(tmp_path: Path, name: str, number: int) -> None:
    check_workers_end(tmp_path, name, number)
