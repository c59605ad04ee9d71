"""Outcomes of flights: what each command prints and returns when an event or an error occurs."""

import csv
import os
import signal
from pathlib import Path

import pytest

from hil.commands import campaign
from hil.common.errors import ConfigError
from tests.support.processes import Program, run_here, write_blind_mission, write_scenario


@pytest.fixture
def into_wall(tmp_path: Path) -> Path:
    return write_blind_mission(tmp_path)


def test_sim_prints_a_collision_and_returns_6(into_wall: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    code, output = run_here("sim", str(into_wall), "--fast")
    assert code == 6, output
    assert "there, but collision with the north wall after 12." in output
    assert "EVENT: collision with the north wall " in output
    assert "name 'collision' in [master] allow" in output
    text = into_wall.read_text()
    into_wall.write_text(text.replace('"link_lost"', '"collision"'))
    code, output = run_here("sim", str(into_wall), "--fast")
    assert code == 0, output
    assert "expected: collision with the north wall" in output


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_sim_writes_its_flight_whatever_signal_ends_it(number: int, into_wall: Path, tmp_path: Path) -> None:
    planner, output = tmp_path / "blind.py", tmp_path / "flight.csv"
    ending = f"__import__('signal').raise_signal({number:d}) if time > 3.0"
    planner.write_text(planner.read_text().replace("Done('there') if time > 12.0", ending))
    where = {"PYTHONPATH": str(tmp_path)}
    with Program(tmp_path, "sim", into_wall, "--fast", "--output", output, environment=where) as sim:
        assert sim.wait() == 130, sim.output
    assert "interrupted after 3" in sim.output
    assert 50 < len(output.read_text().splitlines()) < 70  # 20 rows a second


def test_a_campaign_counts_collisions(
    into_wall: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    output = tmp_path / "runs.csv"
    assert campaign.main([str(into_wall), "--seeds", "1", "--jobs", "1", "-o", str(output)]) == 6
    with output.open() as file:
        (row,) = csv.DictReader(file)
    assert (row["success"], row["reached"], row["collision"], row["capsize"]) == ("False", "True", "1", "0")
    assert "collision with the north wall" in row["events"]
    lines = capsys.readouterr().out.splitlines()
    assert "collision" in lines[0]
    assert "0/1" in "".join(lines)
    assert lines[-1] == "no success: there, but collision with the north wall"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["sim", "paper_field", "--fast", "--plot", "FOLDER/x.png/y.png"], "cannot be written"),
        (["sim", "paper_field", "--fast", "--output", "FOLDER"], "cannot be written"),
        (["sim", "paper_field", "--fast", "--plot", "FOLDER/x.jjj"], "unknown picture format"),
        (["campaign", "paper_field", "-o", "FOLDER"], "cannot be written"),
        (["tune", "paper_six", "-o", "FOLDER/x.png/y.toml"], "cannot be written"),
        (["tune", "paper_six", "--plot", "FOLDER/x.jjj"], "unknown picture format"),
        (["sim", "paper_field", "--fast", "--output", "FOLDER/nope/x.csv"], "there is no folder"),
        (["sim", "paper_field", "--fast", "--output", "FOLDER/pipe.csv"], "it is a pipe"),
        (["sim", "paper_field", "--fast", "--plot", "FOLDER/pipe.png"], "it is a pipe"),
        (["scenario", "schema", "scenario", "--output", "FOLDER/pipe.json"], "it is a pipe"),
        (["world", "export", "pool", "FOLDER/pipe.tif"], "it is a pipe"),
        (["world", "show", "pool", "--output", "FOLDER/pipe.png"], "it is a pipe"),
        (["vehicle", "paper_six", "--plot", "FOLDER/pipe.png"], "it is a pipe"),
        (["case", "path_planning", "--output", "FOLDER/x.png"], "cannot be made"),
        (["master", "paper_field", "--connect", "tcp/127.0.0.1:1", "--output", "FOLDER/x.png"], "cannot be made"),
        (["demo", "paper_field", "--listen", "tcp/127.0.0.1:PORT", "--output", "FOLDER/x.png"], "cannot be made"),
    ],
)
def test_output_paths_are_checked_before_the_flight(arguments: list[str], message: str, tmp_path: Path) -> None:
    """The picture is a file, so nothing can be in it."""
    from importlib import import_module

    from hil.cli import COMMANDS, find_command
    from hil.common.ports import free_ports

    (tmp_path / "x.png").write_text("")
    for ending in ("csv", "png", "json", "tif"):
        os.mkfifo(tmp_path / f"pipe.{ending}")
    name, rest = find_command(
        [a.replace("FOLDER", str(tmp_path)).replace("PORT", str(free_ports(1)[0])) for a in arguments]
    )
    with pytest.raises(ConfigError, match=message):
        import_module(COMMANDS[name][0]).main(rest)


def test_the_master_refuses_a_vehicle_whose_external_controller_is_missing(tmp_path: Path) -> None:
    """The master ends at once, though a recorder subscribes to cmd_vel too."""
    scenario, port = write_scenario(tmp_path, top='controller = "external"')
    endpoint = f"tcp/127.0.0.1:{port}"
    arguments = "master", scenario, "--connect", endpoint, "--output", tmp_path / "run"
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("ready")
        with Program(tmp_path, "recording", "make", "--connect", endpoint, "-o", tmp_path / "recording") as recorder:
            recorder.expect("recording")
            with Program(tmp_path, *arguments) as master:
                assert master.wait() == 4, master.output
    assert 'left to software of its own (controller = "external" in its scenario)' in master.output
    assert "and none has driven its thrusters for 3 s of commands: start that first" in master.output
    assert "time limit" not in master.output
    assert "none listens" not in master.output
