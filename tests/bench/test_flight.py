import csv
from pathlib import Path

import pytest

from hil.bench.flight import Flight
from hil.errors import ConfigError
from sim.simulation import Simulation
from sim.vehicle import load_vehicle, mass_matrix
from sim.world import load_world

PULSES = (1650, 1600, 1600, 1600, 1520, 1520)


@pytest.fixture
def flown() -> Flight:
    simulation = Simulation(load_vehicle("paper_six")[0], load_world("pool"), {}, position=(0.0, 0.0, 2.0))
    flight = Flight(simulation)
    for _ in range(801):
        simulation.step(PULSES)
        flight.note(simulation)
    return flight


def rows_of(flight: Flight, path: Path) -> list[dict[str, float]]:
    flight.write(str(path))
    with path.open() as file:
        return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]


def test_the_table_tells_why_it_moves(flown: Flight, tmp_path: Path) -> None:
    """20 rows a second; the forces add up, and their sum over the mass is the change of speed."""
    rows = rows_of(flown, tmp_path / "flight.csv")
    assert [row["time_s"] for row in rows] == pytest.approx([0.0025, *(k * 0.05 for k in range(1, 41))])
    terms = ("coriolis", "linear_damping", "quadratic_damping", "restoring", "thrusters", "others")
    mass = mass_matrix(load_vehicle("paper_six")[0])[0][0]
    for before, row, after in zip(rows[5:], rows[6:], rows[7:], strict=False):
        assert row["total_x_n"] == pytest.approx(sum(row[f"{term}_x_n"] for term in terms), rel=1e-6, abs=1e-8)
        change = (after["u_m_s"] - before["u_m_s"]) / (after["time_s"] - before["time_s"])
        assert change == pytest.approx(row["total_x_n"] / mass, abs=0.02)
    assert rows[-1]["thrusters_x_n"] > 10.0
    assert rows[-1]["thrust_front_right_n"] > rows[-1]["thrust_front_left_n"] > 1.0


def test_the_picture(flown: Flight, tmp_path: Path) -> None:
    flown.draw(str(tmp_path / "flight.png"))
    assert (tmp_path / "flight.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(ConfigError, match=r"nowhere/flight\.png: cannot be written"):
        flown.draw(str(tmp_path / "nowhere" / "flight.png"))
    with pytest.raises(ConfigError, match=r"nowhere/flight\.csv: cannot be written"):
        flown.write(str(tmp_path / "nowhere" / "flight.csv"))
