"""A mission that goes on after its slave was restarted."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.processes import Program, running_slave, write_scenario


@pytest.fixture
def slave(tmp_path: Path) -> Iterator[tuple[Program, str]]:
    with running_slave(tmp_path) as started:
        yield started


def test_the_master_continues_after_the_slave_was_restarted(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path, allow="")
    folder = tmp_path / "run"
    with Program(tmp_path, "master", scenario, "--output", folder) as master:  # at the endpoint of its scenario
        with Program(tmp_path, "slave", scenario) as slave:
            master.expect("flying")
            slave.process.kill()
            slave.wait()
        master.expect("no odometry from the vehicle")
        with Program(tmp_path, "slave", scenario):
            assert master.wait() == 6, master.output
    assert "goal reached, but link lost: no odometry from uuv1" in master.output, "the goal is not all there is to say"
    record = json.loads((folder / "table.json").read_text())
    lost = [event["duration_s"] for event in record["outcome"]["events"] if event["kind"] == "link_lost"]
    assert max(lost) > 0.5, "and on a busy machine there may be more"
    assert record["outcome"]["reached"]
    assert not record["outcome"]["success"]
    assert record["table"]["startup_s"] > 0, "that of the second slave, by its own first sample"
