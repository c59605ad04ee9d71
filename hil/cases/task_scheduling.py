"""Task scheduling case: charge, acquire and transmit in the order of the scheduler, then return to the start."""

from collections.abc import Mapping, Sequence
from itertools import pairwise, permutations
from math import pi
from typing import Any

from hil.autonomy.paths.occupancy import Point
from hil.autonomy.tasks.scheduler import Mission
from hil.cases.record import Run
from hil.cases.single import SingleCase, random_start, shortest
from hil.master.flight import Plan
from hil.master.planner import Planner
from hil.master.tasks import Tasks
from hil.scenario.config import Scenario
from hil.scenario.variant import Table


class TaskScheduling(SingleCase):
    """Three tasks; each but the first needs the one before it."""

    name = "task_scheduling"
    scenario = "task_scheduling"
    title = "Task scheduling"
    paper = (
        "Figure 10: charging at (5, 5), acquisition at (53, 13) and transmission at (15, 46) are done in the order "
        "that the scheduler, a Stateflow chart, decides. Then the vehicle returns to its start."
    )
    criterion = (
        "Within 10 min all three tasks are done and the vehicle is home. It never came nearer to an obstacle than its "
        "radius"
    )

    def vary(self, seed: int) -> tuple[Mapping[str, Any], Mapping[str, Sequence[Table]]]:
        """Return a random start up to 1 m from the origin, and any heading; nothing for seed 1."""
        if seed == 1:
            return {}, {}
        return random_start(f"task_scheduling/{seed}", 0.0, pi), {}

    def optimum(self, scenario: Scenario, plan: Plan) -> float:
        """Return the length (m) of the shortest path from start to home through all tasks in a permitted order."""
        mission = tasks_of(plan.planner).mission
        start = scenario.start.north, scenario.start.east
        return min(
            shortest(plan.world, plan.request.vehicle, scenario.master.depth, [start, *places, mission.home])
            for places in visit_orders(mission)
        )

    def extra(self, planner: Planner) -> Mapping[str, float]:
        """Return the time (s) at which each task was done."""
        log = tasks_of(planner).log
        ends = {state: end for (_, state), (end, _) in pairwise(log)}
        return {f"{state[:-5]} done": end for state, end in ends.items() if state.endswith(" work")}

    def draw(self, runs: Sequence[Run], path: str) -> None:
        """Draw figure 10: the paths from task to task on the map."""
        from hil.cases.pictures import draw_field

        draw_field(self.title, runs, path)


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
