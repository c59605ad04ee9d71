"""Every torpedo reaches every goal from every heading with the default keys, in still water and across a current."""

from math import pi

import pytest

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
