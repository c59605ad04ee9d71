"""Every torpedo reaches every goal from every heading, in still water and across a current, and can be tuned."""

from math import pi

import pytest

from hil.cases import simulated
from hil.master.flight import prepare
from hil.scenario.config import load_scenario
from hil.tuning.search import Tuner
from sim.vehicle.vehicle import load_vehicle
from tests.support.fin_flights import GOALS, OPEN, TORPEDOES, fin_scenario, fly_fins


@pytest.mark.parametrize("current", [(0.0, 0.0, 0.0), (0.0, 0.3, 0.0)])
@pytest.mark.parametrize("name", TORPEDOES)
def test_all_goals_are_reached_from_all_headings(name: str, current: tuple[float, float, float]) -> None:
    for goal in GOALS.values():
        for heading in (0.0, pi / 2.0, pi, -pi / 2.0):
            scenario = fin_scenario(name, goal, start_heading=heading)
            outcome, plan, vehicle = fly_fins(scenario, OPEN._replace(current=current))
            assert outcome.success, (goal, heading, outcome.verdict)
            assert outcome.goal_error <= plan.request.master.tolerance
            # A straight approach dives all the way, and its depth lags behind the slope.
            assert vehicle.simulation.state.position[2] == pytest.approx(10.0, abs=0.6)


@pytest.mark.parametrize("name", TORPEDOES)
def test_a_vehicle_with_fins_is_tuned_at_its_cruising_speed(name: str) -> None:
    vehicle, control = load_vehicle(name)
    tuner = Tuner(name, vehicle, control)
    assert tuner.axes() == ["surge", "yaw", "depth", "heading"]
    assert tuner.untuned().startswith("not tuned: sway, heave, roll, pitch: its thrusters and fins")
    for tuned in tuner.tune(tuner.axes()):
        before, after = tuned.before.figures(), tuned.after.figures()
        assert after.overshoot < (0.12 if tuned.axis == "yaw" else 0.1), tuned.axis
        assert not tuned.better or after.cost < before.cost or before.overshoot > 0.1, tuned.axis


def test_the_open_water_scenario_reaches_its_goal() -> None:
    """The scenario as delivered, but for a coarser step, reaches its goal, and no obstacle comes nearer than 5 m."""
    scenario = load_scenario("open_water", {"vehicle": "lauv", "slave.step": 0.01})
    plan = prepare(scenario)
    boat = simulated.SimulatedVehicle(scenario, plan.world)
    outcome, _ = simulated.fly(scenario, plan, boat)
    simulation = boat.simulation
    assert outcome.reason == "goal reached"
    assert outcome.goal_error < 3.1
    assert outcome.least_clearance > 5.0
    assert outcome.cross_track_max < 4.0
    assert outcome.travelled / outcome.duration > 1.35
    assert simulation.contacts == 0
    assert simulation.state.position[2] == pytest.approx(10.0, abs=0.3)
