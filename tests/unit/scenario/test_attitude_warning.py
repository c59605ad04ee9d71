"""Warning of sim, demo and doctor about a speed at which the vehicle's model does not stay level."""

from pathlib import Path

import pytest

from hil.scenario.attitude_warning import attitude_warning
from hil.scenario.config import load_scenario

SCENARIO = """
vehicle = "{vehicle}"
world = "pool"
[start]
north = 5.0
east = 5.0
depth = 2.0
[master]
goal = [5.6, 5.0]
depth = 2.0
speed = "{speed} m/s"
time_limit = "30 s"
"""
TIPPING = "bluerov2_heavy_vonbenzon2022"  # above 0.7 m/s


def scenario_file(folder: Path, vehicle: str, speed: float) -> str:
    path = folder / "mine.toml"
    path.write_text(SCENARIO.format(vehicle=vehicle, speed=speed))
    return str(path)


@pytest.mark.parametrize(
    ("vehicle", "speed", "warns"), [(TIPPING, 0.71, True), (TIPPING, 0.7, False), ("bluerov2_heavy", 1.5, False)]
)
def test_the_warning_names_file_key_vehicle_and_both_speeds(
    vehicle: str, speed: float, warns: bool, tmp_path: Path
) -> None:
    path = scenario_file(tmp_path, vehicle, speed)
    warning = attitude_warning(load_scenario(path))
    assert (warning is not None) == warns
    reported = (path, "master: speed", "0.71 m/s", TIPPING, "0.7 m/s", "attitude_limit_speed")
    assert warning is None or all(words in warning for words in reported)


def test_a_hunt_is_checked_by_the_top_speed_of_its_fields(tmp_path: Path) -> None:
    scenario = load_scenario("target_hunting")
    assert scenario.hunting is not None
    assert attitude_warning(scenario) is None
    quick = scenario.hunting._replace(fields=scenario.hunting.fields._replace(max_speed=0.9))
    warning = attitude_warning(scenario._replace(vehicle=TIPPING, hunting=quick))
    assert warning is not None
    assert "hunting: fields: max_speed: 0.9 m/s" in warning
