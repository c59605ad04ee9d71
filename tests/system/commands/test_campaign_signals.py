"""Campaigns and cases that are ended by a signal: no worker outlives them."""

import signal
from pathlib import Path

import pytest

from tests.process.commands.test_campaign import check_workers_end


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
@pytest.mark.parametrize("name", ["campaign", "case"])
def test_no_worker_outlives_the_command(tmp_path: Path, name: str, number: int) -> None:
    check_workers_end(tmp_path, name, number)
