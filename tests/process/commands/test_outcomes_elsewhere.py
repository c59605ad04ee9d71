"""Events of a vehicle in the output of `agent`, `case` and `plot`."""

import json
import signal
from pathlib import Path

import pytest

from hil.cases.path_planning import PathPlanning
from hil.cli import main
from hil.commands import case
from hil.common.ports import free_ports
from hil.plots import run_plots
from hil.recording.mcap_file import Message
from hil.recording.recorder import Recorder
from hil.ros import encoders as ros
from hil.ros.topics import TOPICS
from hil.scenario.records import Recording
from sim.run_events import RunEvent
from sim.sensors.samples import OdometrySample
from tests.process.scenario.test_fleet import HEAD, MEMBER
from tests.support.diagnostics import reported
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


def test_plot_shows_an_event(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The recording takes ten seconds; times in the diagnostics are of the wall clock."""
    start_ns = 1_795_000_000_000_000_000
    hit = RunEvent("collision", start_ns + 4_000_000_000, 1_000_000_000, (2.5, 1.5, 2.0), "the pile")
    figures = reported(run_events=1, run_event_list=(hit,))
    with Recorder(str(tmp_path / "bag"), Recording(keep_free=0.0), {}) as recorder:
        for number in range(11):
            time_ns = start_ns + number * 1_000_000_000
            truth = OdometrySample(
                time_ns, (0.5 * number, 0.3 * number, 2.0), (1.0, 0.0, 0.0, 0.0), (0.5,) + (0.0,) * 5
            )
            output = ros.encode_diagnostics(time_ns, [("uuv1", 0, "running", figures.raw)])
            for name, payload in (("ground_truth", ros.encode_odometry(truth)), ("diagnostics", output)):
                recorder.put(Message(f"/uuv1/{name}", TOPICS[name].type, number, time_ns, time_ns, payload))
    drawn_events: list[tuple[RunEvent, ...]] = []
    monkeypatch.setattr(run_plots, "draw_events", lambda _axes, events: drawn_events.append(tuple(events)))
    assert main(["recording", "plot", str(tmp_path / "bag"), "-o", str(tmp_path / "pictures")]) == 0
    ((event,),) = drawn_events
    assert (event.kind, event.what, event.position) == ("collision", "the pile", (2.5, 1.5, 2.0))
    assert event.start_ns / 1e9 == pytest.approx(4.0, abs=0.01)
    assert (tmp_path / "pictures" / "trajectory.png").stat().st_size > 10_000
