"""The table and the picture of a simulated flight."""

import csv
from pathlib import Path
from typing import Any

import pytest

from hil.plots.force_log import AXES, Flight
from sim.dynamics import Forces
from sim.environment.world import load_world
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle, mass_matrix

PULSES = (1650, 1600, 1600, 1600, 1520, 1520)


@pytest.fixture
def flown() -> Flight:
    simulation = Simulation(load_vehicle("paper_six")[0], load_world("pool"), {}, position=(0.0, 0.0, 2.0))
    flight = Flight(simulation)
    for _ in range(801):
        simulation.step(PULSES)
        flight.record(simulation)
    return flight


def rows_of(flight: Flight, path: Path) -> list[dict[str, float]]:
    flight.write(str(path))
    with path.open() as file:
        return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]


def test_the_forces_in_the_table_explain_the_acceleration(flown: Flight, tmp_path: Path) -> None:
    """The table has 20 rows a second; the forces add up, and their sum over the mass is the change of speed."""
    rows = rows_of(flown, tmp_path / "flight.csv")
    assert [row["time_s"] for row in rows] == pytest.approx([0.0025, *(k * 0.05 for k in range(1, 41))])
    terms = [term for term in Forces._fields if term != "total"]
    mass = mass_matrix(load_vehicle("paper_six")[0])[0][0]
    for before, row, after in zip(rows[5:], rows[6:], rows[7:], strict=False):
        assert row["total_x_n"] == pytest.approx(sum(row[f"{term}_x_n"] for term in terms), rel=1e-6, abs=1e-8)
        change = (after["u_m_s"] - before["u_m_s"]) / (after["time_s"] - before["time_s"])
        assert change == pytest.approx(row["total_x_n"] / mass, abs=0.02)
    assert rows[-1]["thrusters_x_n"] > 10.0
    assert rows[-1]["thrust_front_right_n"] > rows[-1]["thrust_front_left_n"] > 1.0


def test_forces_in_contact_add_up_to_mass_times_acceleration(tmp_path: Path) -> None:
    """A vehicle pushes into the north wall for seconds: no force is missing, not even that of the first contact."""
    vehicle = load_vehicle("paper_six")[0]
    simulation = Simulation(vehicle, load_world("pool"), {}, position=(7.5, 0.0, 2.0))
    flight, felt = Flight(simulation), []
    for _ in range(400 * 6):
        simulation.step((1650, 1650, 1500, 1500, 1500, 1500))
        before = len(flight.rows)
        flight.record(simulation)
        felt += [list(simulation.state.nu_dot)] * (len(flight.rows) - before)
    rows = rows_of(flight, tmp_path / "flight.csv")
    mass = mass_matrix(vehicle)
    touched = [number for number, row in enumerate(rows) if row["contact_x_n"]]
    assert len(touched) > 20
    for number, row in enumerate(rows):
        for axis, line in zip(AXES, mass, strict=True):
            columns = [row[f"{term}_{axis}"] for term in Forces._fields if term != "total"]
            assert row[f"total_{axis}"] == pytest.approx(sum(columns), rel=1e-6, abs=1e-6)
            along = sum(a * b for a, b in zip(line, felt[number], strict=True))
            # The other forces are those after the step, without the speed that the contact has taken.
            slack = max(0.5, (0.05 if number == touched[0] else 0.005) * abs(row["contact_x_n"]))
            assert sum(columns) == pytest.approx(along, abs=slack), (number, axis)
    apply_impulses, pressed = rows[touched[0]], rows[-1]
    assert apply_impulses["contact_x_n"] < -1000.0, "the mean of one step of 2.5 ms"
    assert pressed["contact_x_n"] == pytest.approx(-pressed["thrusters_x_n"], rel=0.05)
    assert pressed["thrusters_x_n"] > 10.0


def test_the_flight_picture_is_drawn(flown: Flight, tmp_path: Path) -> None:
    drawn: list[Any] = []

    def draw_track(*given: Any) -> None:
        drawn.append(given)

    flown.draw(str(tmp_path / "flight.png"), draw_track)
    ((axes, east, north),) = drawn
    assert (axes.get_title("left"), len(east), len(north)) == ("track from above", 41, 41)
    assert (tmp_path / "flight.png").read_bytes().startswith(b"\x89PNG")
