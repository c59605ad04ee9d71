"""Curves of thrust over pulse width, against tables and published formulas."""

import csv
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from hil.common.errors import ConfigError
from sim.assembly import make_thrusters
from sim.vehicle.thrusters.bank import pulse_finder, steady_thrust
from sim.vehicle.thrusters.curves import Advance, read_curve
from sim.vehicle.thrusters.model import Thruster
from sim.vehicle.thrusters.t200 import performance, pulse_for
from sim.vehicle.vehicle import load_vehicle

PRESET = Path(__file__).parents[4] / "sim/vehicles/paper_six.toml"
PLAIN = Thruster("plain", (0, 0, 0), (1, 0, 0), 60.0, 50.0, dead_band_us=25)
TABLE = {"kind": "table", "pwm_us": [1100, 1450, 1540, 1700, 1900], "thrust_n": [-40.0, 0.0, 0.0, 20.0, 55.0]}
CURVES: list[dict[str, Any]] = [
    TABLE,
    {"kind": "advance", "diameter": 0.076, "full_speed": 58.9, "kt0": 0.43, "kt0_reverse": 0.34, "alpha": 0.5},
    {"kind": "t200"},
    {"kind": "t200", "supply": 13.1},
]  # fmt: skip


def curved(**curve: Any) -> Thruster:
    return PLAIN._replace(curve=read_curve(curve, "test.toml: curve"))


WITHOUT_CURVE = [PLAIN, PLAIN._replace(linear_share=1.0), load_vehicle("bluerov2_heavy")[0].thrusters[0]]


@pytest.mark.parametrize("thruster", [*WITHOUT_CURVE, *(curved(**curve) for curve in CURVES)])
def test_every_curve_follows_the_contract(thruster: Thruster) -> None:
    """No thrust comes outside the pulses; it never falls, stays within limits, and inverts to half a pulse."""
    assert [steady_thrust(thruster, pulse) for pulse in (0, -1, 799, 2201, 65535)] == [0.0] * 5
    thrusts = [steady_thrust(thruster, pulse) for pulse in range(800, 2201)]
    assert all(a <= b for a, b in pairwise(thrusts))
    assert -50.0 <= thrusts[0] < -20.0
    assert 30.0 < thrusts[-1] <= 60.0
    assert steady_thrust(thruster, 1500) == 0.0
    assert pulse_finder(thruster)(0.0) == 1500
    assert pulse_finder(thruster)(1e9) <= 1900
    assert pulse_finder(thruster)(-1e9) >= 1100
    for pulse in range(1100, 1901):
        thrust = steady_thrust(thruster, pulse)
        near = [steady_thrust(thruster, pulse + d) for d in (-1, 1)]
        assert steady_thrust(thruster, pulse_finder(thruster)(thrust)) == pytest.approx(thrust, abs=1e-9)
        if near[0] < thrust < near[1] and abs(thrust) > 1e-6:
            assert pulse_finder(thruster)(thrust) == pulse


def test_a_table_saturates_at_its_ends() -> None:
    assert steady_thrust(curved(**{**TABLE, "thrust_n": [-90.0, 0.0, 0.0, 20.0, 95.0]}), 1900) == 60.0
    assert steady_thrust(curved(**{**TABLE, "thrust_n": [-90.0, 0.0, 0.0, 20.0, 95.0]}), 1100) == -50.0
    assert steady_thrust(curved(**TABLE), 1620) == pytest.approx(10.0)


def held_out_points() -> dict[tuple[int, int], tuple[float, float, float, float]]:
    """Return points of the official table that our table lacks: thrust (N), current, power, rpm."""
    path = Path(__file__).parents[3] / "vectors/t200_held_out.csv"
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return {
        (int(row["volt"]), int(row["pwm_us"])): (
            float(row["force_kgf"]) * 9.80665, float(row["current_A"]), float(row["power_W"]), float(row["rpm"])
        )
        for row in csv.DictReader(lines)
    }  # fmt: skip


def test_the_t200_curve_interpolates_between_voltages() -> None:
    """The curve at 14 V is made from 12 and 16 V, which tests linear interpolation in the voltage."""
    for pulse in range(1100, 1901, 20):
        middle = (performance(pulse, 12.0).thrust + performance(pulse, 16.0).thrust) / 2.0
        assert performance(pulse, 14.0).thrust == pytest.approx(middle, abs=0.6)
        assert performance(pulse, 13.0).thrust == pytest.approx(
            (performance(pulse, 12.0).thrust + performance(pulse, 14.0).thrust) / 2.0
        )
    assert performance(1900, 5.0).thrust == pytest.approx(performance(1900, 10.0).thrust / 2.0)
    assert performance(1900, 25.0).thrust == performance(1900, 20.0).thrust
    assert performance(0, 16.0) == (0.0, 0.0, 0.0, 0.0)
    for volts in (10.0, 11.7, 16.0, 20.0):
        for tenth in (-200, -73, -1, 1, 50, 250):
            found = performance(pulse_for(0.1 * tenth, volts), volts).thrust
            assert found == pytest.approx(0.1 * tenth, abs=0.15)


def test_thrust_falls_with_the_advance_speed() -> None:
    """The thrust is rho D⁴ n² (KT0 - alpha J) at full speed, J = v / (n D); a stopped propeller loses nothing."""
    thruster = curved(**CURVES[1])._replace(max_forward=1e3, max_reverse=1e3)
    vehicle = load_vehicle("paper_six")[0]._replace(thrusters=(thruster._replace(position=(0.0, 1.0, 0.0)),))
    thrusters = make_thrusters(vehicle, 0.01)
    assert thrusters.needs_inflow
    for pulse, n, kt in ((1900, 58.9, 0.43), (1100, -58.9, 0.34)):
        for u, r in ((0.0, 0.0), (1.5, 0.0), (-0.7, 0.0), (1.0, 0.5)):
            thrusters.step((pulse,), (u, 9.0, 9.0, 0.0, 0.0, r))
            v = u - r  # a thruster to starboard falls back when the bow turns to starboard
            expected = 1025.0 * 0.076**4 * (kt * n * abs(n) - 0.5 * abs(n) * v / 0.076)
            assert thrusters.thrusts == pytest.approx([expected])
    thrusters.step((1500,), (2.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert thrusters.thrusts == [0.0]
    assert Advance(0.1, 10.0, 0.4, 0.5, wake_fraction=0.2).loss(1.0, 1.0) == pytest.approx(
        0.8 * Advance(0.1, 10.0, 0.4, 0.5).loss(1.0, 1.0)
    )


@pytest.mark.parametrize(
    ("curve", "message"),
    [
        ({"kind": "t-200"}, "kind: 't-200' is not one of table, advance, t200"),
        ({**TABLE, "thrust_n": [-40.0, 0.0, 1.0, 0.5, 55.0]}, "thrust_n: each must be at least"),
        ({**TABLE, "pwm_us": [1100, 1450, 1450, 1700, 1900]}, "pwm_us: each must be greater"),
        ({**TABLE, "thrust_n": [1.0]}, "5 pwm_us and 1 thrust_n"),
        ({**TABLE, "thrust_n": [0.0, 0.0, 0.0, 20.0, 55.0]}, "begins with full reverse"),
    ],
)
def test_wrong_curves_are_reported(curve: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=r"test\.toml: curve") as caught:
        curved(**curve)
    assert message in str(caught.value)


def test_a_vehicle_file_sets_curves(tmp_path: Path) -> None:
    """One is set for all thrusters at once, and one for a single one; a thruster of each kind runs."""
    text = PRESET.read_text().replace("[every_thruster]", '[every_thruster]\ncurve = { kind = "t200" }')
    own = 'name = "rear_left"\ncurve = { kind = "table", pwm_us = [1100, 1900], thrust_n = [-40, 40] }\n'
    path = tmp_path / "mine.toml"
    path.write_text(text.replace('name = "rear_left"\n', own))
    vehicle, control = load_vehicle(str(path))
    assert control
    assert [type(t.curve).__name__ for t in vehicle.thrusters] == ["T200"] * 3 + ["Table"] + ["T200"] * 2
    thrusters = make_thrusters(vehicle, 0.0025)
    for _ in range(400):
        thrusters.step((1800,) * 6)
    assert thrusters.thrusts == pytest.approx([33.54] * 3 + [30.0] + [33.54] * 2, abs=0.01)
