"""Task scheduling case: charge, acquire and transmit in the order of the scheduler, then return to the start."""

from collections.abc import Mapping
from itertools import pairwise, permutations
from math import pi

from hil.autonomy.paths.occupancy import Point
from hil.autonomy.tasks.scheduler import Mission
from hil.cases.single import SingleCase
from hil.master.flight import Plan
from hil.master.planner import Planner
from hil.master.tasks import Tasks
from hil.scenario.config import Scenario


class TaskScheduling(SingleCase):
    """Three tasks; each but the first needs the one before it. Seeds vary the start and its heading."""

    headings = 0.0, pi

    def routes(self, scenario: Scenario, plan: Plan) -> list[list[Point]]:
        """Return the places of the tasks in every permitted order, each with the home behind them."""
        mission = tasks_of(plan.planner).mission
        return [[*places, mission.home] for places in visit_orders(mission)]

    def extra(self, planner: Planner) -> Mapping[str, float]:
        """Return the time (s) at which each task was done."""
        log = tasks_of(planner).log
        ends = {state: end for (_, state), (end, _) in pairwise(log)}
        return {f"{state[:-5]} done": end for state, end in ends.items() if state.endswith(" work")}


def tasks_of(planner: Planner) -> Tasks:
    """Return the planner of this case as `Tasks`."""
    assert isinstance(planner, Tasks), "the scenario of this case uses this planner"
    return planner


def visit_orders(mission: Mission) -> list[list[Point]]:
    """Return the positions of the tasks in every order in which each task comes after the tasks it needs."""
    orders = []
    for order in permutations(mission.task):
        names = [task.name for task in order]
        if all(names.index(other) < place for place, task in enumerate(order) for other in task.needs):
            orders.append([task.at for task in order])
    return orders
