"""Figures of a recording, and the recording of a master."""

import os
import sys
from collections import Counter
from pathlib import Path

import pytest

from hil.recording.reader import read_about, read_messages
from hil.recording.recorder import Recorder
from hil.scenario.records import Recording
from tests.support.network.recorded_dive import record_dive, recorded_slave
from tests.support.processes import Program, run_here

FORCE = """
class Force:
    def begin(self, time_ns): pass
    def wrench(self, position, rotation, nu_r): return [0.0] * 6
"""


@pytest.fixture(scope="module")
def dive(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, str]:
    return record_dive(tmp_path_factory.mktemp("dive"))


def test_no_command_loads_classes_of_a_recording_without_permission(
    tmp_path: Path, dive: tuple[Path, Path, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    description, trace = read_about(str(dive[0])), tmp_path / "trace"
    (tmp_path / "strange.py").write_text(f"open({str(trace)!r}, 'w').close()\n{FORCE}")
    files = description.attachments | {
        "scenario.toml": description.attachments["scenario.toml"] + '[[force]]\nclass = "strange:Force"\n'
    }
    with Recorder(str(tmp_path / "bag"), Recording(keep_free=0.0), description.facts, files) as recorder:
        for message in read_messages(str(dive[0])):
            recorder.put(message)
    monkeypatch.syspath_prepend(str(tmp_path))
    commands = (
        ["recording", "plot"],
        ["recording", "replay", "--check"],
    )
    for family, command, *options in commands:
        code, output = run_here(family, command, str(tmp_path / "bag"), *options)
        assert code == 2, output
        assert "force[0]: class 'strange:Force' is not loaded" in output
        assert "give --own-classes, only if you trust where this recording comes from" in output
        assert not trace.exists()
    assert "strange" not in sys.modules
    for family, command, *options in commands:
        code, output = run_here(family, command, str(tmp_path / "bag"), *options, "--own-classes")
        assert code == 0, output
        assert trace.exists()
        trace.unlink()
        del sys.modules["strange"]


def test_plot_draws_each_figure(tmp_path: Path, dive: tuple[Path, Path, str]) -> None:
    with Program(tmp_path, "recording", "plot", dive[0], "-o", tmp_path / "figures") as plot:
        assert plot.wait() == 0, plot.output
    names = {"trajectory.png", "depth.png", "commands.png", "thrusters.png", "delays.png"}
    assert set(os.listdir(tmp_path / "figures")) == names
    for name in names:
        picture = (tmp_path / "figures" / name).read_bytes()
        assert picture.startswith(b"\x89PNG")
        assert len(picture) > 15_000, "there is something drawn"


def test_the_master_records_its_flight(tmp_path: Path) -> None:
    scenario, endpoint = recorded_slave(tmp_path)
    scenario.write_text(scenario.read_text().replace("goal = [8, 7]", "goal = [5.5, 5]"))
    folder = tmp_path / "run"
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("ready")
        with Program(tmp_path, "master", scenario, "--connect", endpoint, "--output", folder) as master:
            assert master.wait() == 0, master.output
    messages = list(read_messages(str(folder / "recording")))
    counts = Counter(message.topic for message in messages)
    rows = len((folder / "track.csv").read_text().splitlines()) - 1
    assert abs(counts["/uuv1/cmd_vel"] - rows) <= 2
    assert counts["/uuv1/imu"] > 4 * counts["/uuv1/odom"] > 100
    assert counts["/uuv1/trace"] > 0.9 * counts["/uuv1/cmd_vel"]
    assert read_about(str(folder / "recording")).facts["recorded_by"] == "master"
    assert all(message.logged_ns - message.published_ns < 60e9 for message in messages), "of one clock"
