"""Events of a vehicle in the output of `agent`, `case` and `plot`."""

import json
import signal
from pathlib import Path

import pytest

from hil.cases.path_planning import PathPlanning
from hil.cli import main
from hil.commands import case
from hil.common.ports import free_ports
from tests.process.scenario.test_fleet import HEAD, MEMBER
from tests.support.processes import Program


def test_agent_prints_an_event_and_returns_6(tmp_path: Path) -> None:
    """The vehicle touches the seabed as it goes a little deeper than commanded on its way down."""
    ports = free_ports(6)
    rows = [MEMBER.format(node=f"uuv{i}", port=ports[i], agent=ports[3 + i], north=5 - 4 * i) for i in range(3)]
    path = tmp_path / "fleet.toml"
    head = HEAD.replace("depth = 2", "depth = 1", 1)
    path.write_text(f"{head}depth_margin = 0\n{''.join(rows)}[hunting]\ntarget = [0, 7]\n", encoding="utf-8")
    with (
        Program(tmp_path, "slave", path, "--member", "uuv0") as slave,
        Program(tmp_path, "fleet", "agent", path, "--member", "uuv0") as agent,
    ):
        slave.expect("ready")
        agent.expect("too deep, at")
        assert agent.stop(signal.SIGINT) == 6, agent.output
    assert "EVENT: too deep" in agent.output
    assert "uuv-hil fleet: uuv0: too deep" in agent.output


def test_case_prints_an_event_and_returns_6(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The event is in the table and in the results; the pictures of the report are tested elsewhere."""
    monkeypatch.setattr(case, "write_report", lambda *_: [])
    monkeypatch.setattr(PathPlanning, "vary", lambda _self, _seed: ({"master.depth_margin": 0.0}, {}))
    assert main(["case", "path_planning", "--jobs", "1", "--output", str(tmp_path)]) == 6
    output = capsys.readouterr().out
    assert "EVENT: too deep" in output, output
    (row,) = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert row["success"] is False
    assert row["events"]
    assert row["events"][0].startswith("too deep")
