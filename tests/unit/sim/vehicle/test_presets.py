"""The presets against published figures, beyond what loading checks."""

from math import sqrt

import pytest

from hil.common.schema import preset_names
from sim.environment.world import load_world
from sim.simulation import Simulation
from sim.vehicle.thrusters.bank import wrench_matrix
from sim.vehicle.vehicle import Vehicle, load_vehicle

NAMES = preset_names("sim/vehicles")
# Six rows, X Y Z K M N.
TAM_VON_BENZON: list[list[float]] = [  # the authors' TAM_mat
    [0.707107, 0.707107, -0.707107, -0.707107, 0, 0, 0, 0],
    [-0.707107, 0.707107, -0.707107, 0.707107, 0, 0, 0, 0],
    [0, 0, 0, 0, -1, 1, 1, -1],
    [0, 0, 0, 0, 0.218, 0.218, -0.218, -0.218],
    [0, 0, 0, 0, 0.12, -0.12, 0.12, -0.12],
    [-0.188798, 0.188798, 0.188798, -0.188798, 0, 0, 0, 0],
]
TAM_REXROV = [  # uuv_simulator, uuv_thruster_manager/config/rexrov/TAM.yaml (Apache-2.0), rounded; FLU
    [0.1597427, 0.1597427, -0.1597424, -0.1597424, 0.7071069, 0.7071069, -0.7071065, -0.7071065],
    [-0.2136101, 0.2136101, -0.2136098, 0.2136098, 0.7071067, -0.7071067, 0.7071070, -0.7071070],
    [0.9637702, 0.9637702, 0.9637703, 0.9637703, 0.0, 0.0, 0.0, 0.0],
    [0.4352320, -0.4352320, 0.4352319, -0.4352319, -0.0912168, 0.0912168, -0.0912168, 0.0912168],
    [0.9430935, 0.9430935, -0.9430935, -0.9430935, 0.0912168, 0.0912168, -0.0912167, -0.0912167],
    [0.1368886, -0.1368886, -0.1368884, 0.1368884, -0.6487988, 0.6487988, 0.6487987, -0.6487987],
]


def columns(matrix: list[list[float]]) -> list[tuple[float, ...]]:
    return list(zip(*matrix, strict=True))


def matrix_of(name: str) -> list[list[float]]:
    return wrench_matrix(load_vehicle(name)[0])


@pytest.mark.parametrize("name", NAMES)
def test_every_preset_stays_still_and_stable_under_thrust(name: str) -> None:
    """Neutral pulses leave it within its trim; full thrust on every channel keeps its motion bounded."""
    vehicle, _ = load_vehicle(name)
    assert vehicle.name == name
    world = load_world("paper_field")._replace(cylinder=(), box=())
    start = (5.0, 5.0, 0.0 if vehicle.hull else 4.0)
    resting = Simulation(vehicle, world, position=start)
    for _ in range(400):
        resting.step([1500] * len(vehicle.channels))
    assert all(abs(x) < 0.3 for x in resting.state.nu)
    for pulses in ([1900] * len(vehicle.channels), [1100] * len(vehicle.channels)):
        thrusting = Simulation(vehicle, world, position=start)
        for _ in range(800):
            thrusting.step(pulses)
        assert all(abs(x) < 20.0 for x in thrusting.state.nu)


def test_von_benzons_published_matrix_agrees_with_the_thruster_poses() -> None:
    """The same eight columns stand in another order, some with the other sign of thrust."""
    columns_heavy = columns(matrix_of("bluerov2_heavy"))
    for published in columns(TAM_VON_BENZON):
        flipped = tuple(-x for x in published)
        assert any(column == pytest.approx(same, abs=1e-6) for column in columns_heavy for same in (published, flipped))


def test_rexrovs_published_matrix_agrees_with_the_thruster_poses() -> None:
    """The rows Y, Z, M and N change sign from FLU to FRD; so this tests the preset's turn as well."""
    signs = (1.0, -1.0, -1.0, 1.0, -1.0, -1.0)
    for sign, row, published in zip(signs, matrix_of("rexrov"), TAM_REXROV, strict=True):
        assert row == pytest.approx([sign * x for x in published], abs=2e-6)


def test_paper_seven_is_paper_six_with_seven_thrusters() -> None:
    six, seven = load_vehicle("paper_six")[0], load_vehicle("paper_seven")[0]
    assert seven._replace(name=six.name, thrusters=six.thrusters) == six
    assert len(seven.thrusters) == 7
    vertical = [t for t in seven.thrusters if t.direction[2]]
    assert len(vertical) == 3
    assert sum(t.position[0] for t in vertical) == pytest.approx(0.0)  # equal thrusts make no pitch
    length, width, _ = seven.dimensions
    assert all(abs(t.position[0]) < length / 2 and abs(t.position[1]) < width / 2 for t in seven.thrusters)


def test_estimates_follow_their_stated_rules() -> None:
    """The numbers that the paper lacks, worked out again from the rules in the file's comments."""
    for name in ("paper_six", "paper_seven"):
        vehicle, _ = load_vehicle(name)
        assert vehicle.inertia == pytest.approx(box_inertia(vehicle), rel=0.01)
        length, width, height = vehicle.dimensions
        faces = width * height, length * height, length * width
        assert vehicle.quadratic_damping[:3] == pytest.approx([0.5 * 1000.0 * 1.05 * face for face in faces], rel=0.005)
        for size, face, added in zip(vehicle.dimensions, faces, vehicle.added_mass, strict=False):
            assert added == pytest.approx(prism_coefficient(size / sqrt(face)) * vehicle.mass, rel=0.01)


def box_inertia(vehicle: Vehicle) -> list[float]:
    squares = [size * size for size in vehicle.dimensions]
    return [vehicle.mass / 12.0 * (sum(squares) - own) for own in squares]


def prism_coefficient(ratio: float) -> float:
    """Return the coefficient of DNV-RP-H103, table A-2: by line from 0.68 at 1 to 0.36 at 2, by a power law below 1."""
    if ratio >= 1.0:
        return 0.68 + (0.36 - 0.68) * (ratio - 1.0)
    exponent = 0.917  # of the line from 0.68 at 1 through the ratio of 0.36 to 0.68 at 2
    return float(0.68 * ratio**-exponent)
