"""Every torpedo reaches every goal from every heading, in still water and across a current, and can be tuned."""

from math import pi

import pytest

from hil.tuning.search import Tuner
from sim.vehicle.vehicle import load_vehicle
from tests.support.fin_flights import GOALS, OPEN, TORPEDOES, fin_scenario, fly_fins


@pytest.mark.parametrize("current", [(0.0, 0.0, 0.0), (0.0, 0.3, 0.0)])
@pytest.mark.parametrize("name", TORPEDOES)
def test_all_goals_are_reached_from_all_headings(name: str, current: tuple[float, float, float]) -> None:
    for goal in GOALS.values():
        for heading in (0.0, pi / 2.0, pi, -pi / 2.0):
            scenario = fin_scenario(name, goal, start_heading=heading)
            outcome, plan, _ = fly_fins(scenario, OPEN._replace(current=current))
            assert outcome.success, (goal, heading, outcome.verdict)
            assert outcome.goal_error <= plan.request.master.tolerance


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
