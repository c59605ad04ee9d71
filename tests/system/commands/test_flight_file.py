"""The scenario that `vehicle --import --flight` writes: `scenario check` accepts it, and it reaches its goal."""

from pathlib import Path
from typing import Any

import pytest

from hil.cli import main
from hil.commands.vehicle.flight_file import check_files, scenario_of
from hil.common.tables import read_table
from hil.doctor.vehicle.subject import Subject
from hil.scenario.config import load_scenario
from sim.vehicle.vehicle import Vehicle, load_vehicle

VECTORS = Path(__file__).parents[2] / "vectors"
ROV = load_vehicle("paper_six")[0]


def flight(folder: Path, vehicle: Vehicle = ROV, **sensors: dict[str, Any]) -> tuple[dict[str, Any], str]:
    """Return the scenario for a vehicle with these sensors as a table, and the notes."""
    notes: list[str] = []
    path = folder / "flight.toml"
    path.write_text(scenario_of("paper_six", str(path), Subject(vehicle, {}), sensors, notes))
    return read_table(str(path)), " ".join(notes)


@pytest.mark.parametrize(
    ("rate", "step", "written", "note"),
    [
        (400.0, None, 400.0, ""),
        (1000.0, 0.001, 1000.0, "The step is 1 ms"),
        (600.0, 0.001666666, 600.0, "The step is 1.67 ms"),
        (1500.0, 0.001, 1000.0, "measures 1000 times a second, not 1500"),
    ],
)
def test_the_step_is_as_short_as_the_fastest_sensor_needs(
    rate: float, step: float | None, written: float, note: str, tmp_path: Path
) -> None:
    table, notes = flight(tmp_path, imu={"rate": rate})
    assert table.get("slave", {}).get("step") == step
    assert table["sensors"]["imu"]["rate"] == written
    assert note in notes
    text = (tmp_path / "flight.toml").read_text()
    assert check_files((Path("sim/vehicles/paper_six.toml").read_text(), text), ("v.toml", "f.toml")) == []


def test_sensors_that_no_scenario_can_have_are_changed_or_left_out_with_a_note(tmp_path: Path) -> None:
    table, notes = flight(tmp_path, laser={"rate": 500.0}, dvl={"tilt": 7.0})
    assert table["sensors"] == {"laser": {"rate": 100.0}}
    assert "The sensor laser measures 100 times a second, not 500." in notes
    assert "Left out: the sensor dvl: sensors: dvl: tilt" in notes


def test_speed_time_and_depth_are_those_that_the_vehicle_reaches(tmp_path: Path) -> None:
    assert set(flight(tmp_path)[0]["master"]) == {"goal", "depth"}
    weak = [t._replace(max_forward=4.0, max_reverse=4.0) for t in ROV.thrusters]
    master = flight(tmp_path, ROV._replace(thrusters=tuple(weak)))[0]["master"]
    top = Subject(ROV._replace(thrusters=tuple(weak)), {}).capabilities[0].speed[0]
    assert master["speed"] == pytest.approx(0.6 * top, abs=1e-3)
    assert master["time_limit"] * master["speed"] > 2.0 * 20.0 * 2.0**0.5
    flat = tuple([t for t in ROV.thrusters if abs(t.unit_direction[2]) < 0.5])
    craft = flight(tmp_path, ROV._replace(thrusters=flat, neutrally_buoyant=False, volume=0.02))[0]
    assert (craft["start"]["depth"], craft["master"]["depth"]) == ("0 m", "0 m")
    torpedo = flight(tmp_path, load_vehicle("remus100")[0])[0]["master"]
    assert set(torpedo) <= {"goal", "depth", "time_limit"}, "speed, lookahead and tolerance are left to the defaults"


def test_an_imported_vehicle_reaches_the_goal_of_its_flight(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [str(tmp_path / name) for name in ("v.toml", "f.toml")]
    model = str(VECTORS / "hydra.urdf")
    assert main(["vehicle", "--import", model, "-o", files[0], "--flight", files[1], "--strict"]) == 0
    assert main(["scenario", "check", files[1], "--strict"]) == 0
    assert main(["sim", files[1], "--fast"]) == 0
    assert load_scenario(files[1]).vehicle == files[0]


def test_a_flight_that_cannot_succeed_is_not_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, scenario, rest = tmp_path / "v.toml", tmp_path / "f.toml", tmp_path / "rest.toml"
    rest.write_text(
        '[[thrusters]]\nname = "up"\nposition = [0, 0, 0]\ndirection = [0, 0, 1]\nmax_forward = 9\nmax_reverse = 9\n'
    )
    command = ["vehicle", "--import", str(VECTORS / "hydra.urdf"), "--add", str(rest), "-o", str(path)]
    assert main([*command, "--flight", str(scenario)]) == 1
    output = capsys.readouterr().out
    assert "has no thruster that pushes ahead, so it cannot reach the goal" in output
    assert f"{scenario}: not written" in output
    assert (path.exists(), scenario.exists()) == (True, False)
