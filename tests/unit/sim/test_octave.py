"""Terms of the equations of motion against the MSS toolbox (MIT, T. I. Fossen), run in GNU Octave 7.3."""

import json
from pathlib import Path
from typing import Any

import pytest

from sim.dynamics import Dynamics
from sim.matrices import product, square
from sim.rotations import from_euler, matrix
from sim.vehicle.vehicle import Vehicle, load_vehicle, rigid_mass_matrix

ORACLE: dict[str, Any] = json.loads((Path(__file__).parents[2] / "vectors" / "mss_octave.json").read_text())
LEVEL = matrix((1.0, 0.0, 0.0, 0.0))
NOTHING, STILL, DEEP = (0.0,) * 6, (0.0, 0.0, 0.0), 1000.0
EXACT = 1e-9
HEAVY, _ = load_vehicle("bluerov2_heavy_vonbenzon2022")  # whose Munk moment is that of an ideal fluid


def body(mass_matrix: list[list[float]], **changes: Any) -> Vehicle:
    """Return a weightless body without drag whose whole mass matrix is `whole`."""
    rigid = square([0.01] * 6, 6)
    added = [m - r for row in zip(mass_matrix, rigid, strict=True) for m, r in zip(*row, strict=True)]
    return HEAVY._replace(
        mass=0.01, inertia=(0.01,) * 3, added_mass=tuple(added), neutrally_buoyant=True,
        center_of_buoyancy=(0.0, 0.0, 0.0), linear_damping=(0.0,) * 6, quadratic_damping=(0.0,) * 6,
    )._replace(**changes)  # fmt: skip


def force(vehicle: Vehicle, nu: list[float]) -> list[float]:
    """Return M nu', read out of the accelerations."""
    dynamics = Dynamics(vehicle, 1000.0, 10.0)
    nu_dot = dynamics.acceleration(DEEP, LEVEL, nu, NOTHING, STILL)
    return [row[0] for row in product(dynamics.mass, [[x] for x in nu_dot])]


def test_coriolis_of_a_full_matrix_equals_mss() -> None:
    """The product C(nu) nu of any symmetric M is that of m2c."""
    case = ORACLE["m2c_full"]
    expected = [-row[0] for row in product(case["C"], [[x] for x in case["nu"]])]
    assert force(body(case["M"]), case["nu"]) == pytest.approx(expected, rel=EXACT, abs=EXACT)


def test_coriolis_of_added_mass_equals_mss() -> None:
    """The product C_A(nu) nu of a prolate spheroid is that of imlay61."""
    case = ORACLE["imlay61"]
    expected = [-row[0] for row in product(case["CA"], [[x] for x in case["nu"]])]
    diagonal = square(case["MA_diag"], 6)
    assert force(body(diagonal), case["nu"]) == pytest.approx(expected, rel=EXACT, abs=EXACT)


def test_rigid_body_matrices_equal_mss() -> None:
    """The matrix M_RB about an origin off the centre of gravity, and C_RB(nu) nu in a turn, are those of spheroid."""
    case = ORACLE["spheroid"]
    mass, lever = case["MRB"][0][0], case["r_bg"][2]
    inertia = (case["MRB"][3][3] - mass * lever**2, case["MRB"][4][4] - mass * lever**2, case["MRB"][5][5])
    vehicle = HEAVY._replace(mass=mass, inertia=inertia, center_of_gravity=tuple(case["r_bg"]))
    for mine, theirs in zip(rigid_mass_matrix(vehicle), case["MRB"], strict=True):
        assert mine == pytest.approx(theirs, rel=EXACT, abs=EXACT)
    nu = [0.0, 0.0, 0.0, *case["nu2"]]
    expected = [-row[0] for row in product(case["CRB"], [[x] for x in nu])]
    assert force(body(case["MRB"]), nu) == pytest.approx(expected, rel=EXACT, abs=EXACT)


def test_restoring_forces_equal_mss() -> None:
    """The forces of W 1000 N and B 1010 N, both centres off the origin, are those of gvect."""
    case = ORACLE["gvect"]
    vehicle = body(
        square([500.0] * 3 + [50.0] * 3, 6), mass=100.0, volume=0.101, neutrally_buoyant=False,
        center_of_gravity=tuple(case["r_bg"]), center_of_buoyancy=tuple(case["r_bb"]),
    )  # fmt: skip
    assert (vehicle.mass * 10.0, vehicle.volume * 1e4) == pytest.approx((case["W"], case["B"]))
    dynamics = Dynamics(vehicle, 1000.0, 10.0)
    rotation = matrix(from_euler(case["phi"], case["theta"], 0.0))
    nu_dot = dynamics.acceleration(DEEP, rotation, NOTHING, NOTHING, STILL)
    g = [-row[0] for row in product(dynamics.mass, [[x] for x in nu_dot])]
    assert g == pytest.approx(case["g"], rel=EXACT)
