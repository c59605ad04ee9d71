"""Loading a file lists all of its mistakes, from every section, in the order of the file."""

from pathlib import Path

import pytest

from hil.common.errors import ConfigError
from hil.common.schema import find_preset
from hil.scenario.config import load_scenario
from sim.vehicle.vehicle import load_vehicle

SCENARIO = """
vehicle = "paper_sevn"
world = "paper_field"
sped = 1
[slave]
step = "2.5 kg"
deadman_ms = 300
[sensors.imu]
rat = 5
[sensors.dvl]
latency = "soon"
[link]
baud = 1
[link.faults]
dorp = 0.1
[[failure]]
thruster = "a"
kind = "explodes"
time = 1
[modem]
kind = "radio"
slot = -1
[master]
speed = 20.0
"""


def mistakes(error: ConfigError, path: Path) -> list[str]:
    """Return the places of an error's lines, without the file."""
    lines = str(error).splitlines()
    assert all(line.startswith(f"{path}: ") for line in lines)
    return [line.removeprefix(f"{path}: ") for line in lines]


def test_a_scenario_lists_the_mistakes_of_all_sections(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(SCENARIO)
    with pytest.raises(ConfigError) as caught:
        load_scenario(str(path))
    starts = [
        "vehicle: no vehicle 'paper_sevn'; did you mean 'paper_seven'?", "no key 'sped'", "slave: step: has the unit",
        "slave: no key 'deadman_ms'; write deadman = \"300 ms\"", "sensors: imu: no key 'rat'", "sensors: dvl: latency",
        "link: baud", "link: faults: no key 'dorp'", "failure[0]: kind", "modem: slot", "modem: no key 'kind'",
        "master: speed",
    ]  # fmt: skip
    found = mistakes(caught.value, path)
    assert [line.startswith(start) for line, start in zip(found, starts, strict=True)] == [True] * len(starts), found


def test_a_change_is_named_with_the_mistakes_that_it_makes(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('vehicle = "paper_six"\nworld = "paper_field"\n[master]\nsped = 1\n')
    with pytest.raises(ConfigError) as caught:
        load_scenario(str(path), {"slave.step": "1 kg", "master.depth": "2m", "link.baud": 1})
    lines = str(caught.value).splitlines()
    starts = [f"{path}: master: no key 'sped'", "--set slave.step: has the unit 'kg'", "--set link.baud: 1 "]
    assert [line.startswith(start) for line, start in zip(lines, starts, strict=True)] == [True] * 3, lines


def test_a_vehicle_lists_the_mistakes_of_all_sections_and_common_ones_once(tmp_path: Path) -> None:
    text = Path(find_preset("sim/vehicles", "remus100")).read_text()
    path = tmp_path / "mine.toml"
    path.write_text(
        text.replace('stall_angle = "30 deg"\n', 'span = 1.0\nstall_angle = "2 m"\n').replace(
            "[cross_flow]\n", "[cross_flow]\nlenght = 1\n"
        )
        + "[battery]\ncells = 4\n[collision]\nfriction = -1\n"
    )
    with pytest.raises(ConfigError) as caught:
        load_vehicle(str(path))
    found = mistakes(caught.value, path)
    assert len(found) > 5
    for start in ("every_fin: no key 'span'", "every_fin: stall_angle: ", "cross_flow: no key 'lenght'",
                  "collision: friction: ", "battery: no key 'cells'", "battery: key 'capacity_wh'"):  # fmt: skip
        assert sum(line.startswith(start) for line in found) == 1, found


@pytest.mark.parametrize("drag", ["1.1", "[1.1]"])
def test_one_number_stands_for_an_array_of_one(tmp_path: Path, drag: str) -> None:
    path = tmp_path / "mine.toml"
    text = Path(find_preset("sim/vehicles", "paper_six")).read_text()
    path.write_text(f"{text}\n[cross_flow]\ndrag = {drag}\nlength = '2ft'\n")
    vehicle, _ = load_vehicle(str(path))
    assert vehicle.cross_flow is not None
    assert (vehicle.cross_flow.drag, vehicle.cross_flow.length) == ((1.1,), 0.6096)
