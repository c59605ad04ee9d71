"""Vehicle files: presets, common keys, and the rigid body mass matrix."""

from math import inf, nan
from pathlib import Path
from typing import Any

import pytest

from hil.common.errors import ConfigError
from hil.common.schema import parse
from sim.matrices import inverse, product
from sim.vehicle.vehicle import Vehicle, load_vehicle, mass_matrix

TABLE: dict[str, Any] = {
    "name": "cube", "source": "test", "mass": 10.0, "volume": 0.01, "dimensions": [0.3, 0.3, 0.3],
    "inertia": [0.1, 0.1, 0.1], "center_of_buoyancy": [0.0, 0.0, -0.01],
    "added_mass": [5.0, 5.0, 5.0, 0.1, 0.1, 0.1], "linear_damping": [1.0] * 6, "quadratic_damping": [10.0] * 6,
    "thrusters": [{"name": "a", "position": [0, 0, 0], "direction": [3, 4, 0], "max_forward": 10, "max_reverse": 5}],
}  # fmt: skip


def build(**changes: Any) -> Vehicle:
    return parse({**TABLE, **changes}, Vehicle, "test.toml")


def test_the_reference_vehicle_is_as_published() -> None:
    vehicle, _ = load_vehicle("paper_six")
    assert vehicle.dimensions == (0.378, 0.302, 0.234)
    assert vehicle.mass == 9.7
    assert vehicle.neutrally_buoyant
    assert len(vehicle.thrusters) == 6
    assert {round(t.max_forward, 6) for t in vehicle.thrusters} == {73.549875}
    assert {round(t.max_reverse, 6) for t in vehicle.thrusters} == {49.03325}


def test_the_control_table_and_common_thruster_keys_are_read(tmp_path: Path) -> None:
    preset = Path(__file__).parents[4] / "sim/vehicles/paper_six.toml"
    text = preset.read_text().split("[control")[0]
    path = tmp_path / "mine.toml"
    path.write_text(text + "\n[control]\ngain = 3\n")
    vehicle, control = load_vehicle(str(path))
    assert control == {"gain": 3}
    assert vehicle == load_vehicle("paper_six")[0]
    wrong = text.replace("[every_thruster]", '[every_thruster]\ntorq = 1\ndiameter = "x"')
    path.write_text(wrong.replace('name = "rear_left"', 'name = "rear_left"\ncurv = 3'))
    with pytest.raises(ConfigError) as caught:
        load_vehicle(str(path))
    places = [problem.removeprefix(f"{path}: ").partition(" ")[0] for problem in caught.value.args]
    assert places == ["every_thruster:", "every_thruster:", "thrusters[3]:"]  # a common mistake is reported once


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"inertia": [0.1, 0.1]}, "inertia needs 3 numbers"),
        ({"inertia": [0.1, 0.05, 0, 0.2, 0.1, 0, 0, 0, 0.1]}, "inertia is not symmetric"),
        ({"inertia": [0.1, 0.1, -0.1]}, "inertia is not symmetric and positive definite"),
        ({"added_mass": [-20.0, 5.0, 5.0, 0.1, 0.1, 0.1]}, "write added mass positive"),
        ({"added_mass": [1.0] + [0.0] * 34 + [1.0, 2.0]}, "added_mass needs 6 numbers"),
        ({"added_mass": [1.0, 2.0] + [0.0] * 34}, "added_mass is not symmetric"),
        ({"inertia": [0.1, 0.1, 0.21]}, "inertia is that of no body"),
        ({"linear_damping": [-1.0] * 6}, "linear_damping is negative"),
        ({"linear_damping": [1.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0] + [1.0, *[0.0] * 6] * 4 + [1.0]}, "makes energy"),
        ({"forward_speed_damping": [1.0] * 5}, "forward_speed_damping needs 6 numbers"),
        ({"thrusters": []}, "1 to 16 thrusters, found 0"),
        ({"thrusters": TABLE["thrusters"] * 2}, "same name"),
        ({"thrusters": [{**TABLE["thrusters"][0], "direction": [0, 0, 0]}]}, "'a': direction is zero"),
        ({"thrusters": [{**TABLE["thrusters"][0], "direction": [1e-300, 0, 0]}]}, "direction is shorter than 1e-06"),
        ({"thrusters": [{**TABLE["thrusters"][0], "direction": [1e-160, 1e-160, 0]}]}, "shorter than 1e-06"),
        ({"thrusters": [{**TABLE["thrusters"][0], "pwm_max_us": 1400}]}, "leave no pulse"),
        ({"thrusters": [{**TABLE["thrusters"][0], "pwm_min_us": 1480, "dead_band_us": 20}]}, "leave no pulse"),
        ({"mass": 11.0, "volume": 11.0}, "write the volume in cubic metres (11 litres are 0.011)"),
        ({"mass": 11_000.0, "volume": 0.011}, "and the mass in kg"),
    ],
)
def test_wrong_vehicles_are_reported(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=r"test\.toml") as caught:
        build(**changes)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"mass": inf}, "mass: inf is not finite"), ({"inertia": (0.1, nan, 0.1)}, "inertia: nan is not finite"),
        ({"dimensions": (0.3, 0.3, 0.0)}, "must be above 0"), ({"munk_share": (0.0, 1.0, 1.1)}, "munk_share: each"),
        ({"capsize_tilt": 0.0}, "capsize_tilt: 0 rad is outside"), ({"capsize_tilt": 0.5}, "None"),
    ],
)  # fmt: skip
def test_a_vehicle_that_is_no_file_is_checked_as_well(changes: dict[str, Any], problem: str) -> None:
    assert problem in str(build()._replace(**changes).validate())


def test_a_thruster_direction_may_have_any_length() -> None:
    assert build().thrusters[0].unit_direction == pytest.approx((0.6, 0.8, 0.0))


def test_the_inverse_matrix_is_exact() -> None:
    matrix = mass_matrix(build(center_of_gravity=[0.01, 0.02, 0.03]))
    unit = product(matrix, inverse(matrix))
    assert [x for row in unit for x in row] == pytest.approx([float(i % 7 == 0) for i in range(36)], abs=1e-13)


@pytest.mark.parametrize("key", ["every_thruster", "every_fin", "battery", "collision", "buoyancy_engine"])
def test_a_misspelt_table_is_suggested(tmp_path: Path, key: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f"[{key[:-2]}{key[-1]}]\n")
    with pytest.raises(ConfigError, match=f"did you mean '{key}'"):
        load_vehicle(str(path))
