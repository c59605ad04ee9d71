"""The task scheduler: the reference platform's three tasks, with interruptions and priorities."""

import math
import os
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.autonomy.tasks.scheduler import Condition, Mission, Scheduler, Task, TaskGoal
from hil.common.errors import ConfigError
from hil.common.schema import load

SECOND = 1_000_000_000
Point = tuple[float, float]

CHARGING = Task("charging", (5.0, 5.0), 60.0, "battery < 0.3", priority=2, urgent=True, repeat=True)
ACQUISITION = Task("acquisition", (53.0, 13.0), 30.0)
TRANSMISSION = Task("transmission", (15.0, 46.0), 20.0, "data > 0.9", needs=("acquisition",))
MISSION = Mission((0.0, 0.0), (CHARGING, ACQUISITION, TRANSMISSION))


class World:
    """A vehicle at 1 m/s whose battery and data change with its task."""

    def __init__(self, scheduler: Scheduler, drain: float = 0.002) -> None:
        self.scheduler, self.drain = scheduler, drain
        self.position: Point = (0.0, 0.0)
        self.signals = {"battery": 1.0, "data": 0.0}
        self.time = 0

    def step(self) -> TaskGoal:
        order = self.scheduler.step(self.time, self.position, self.signals)
        if order.goal:
            left = math.dist(self.position, order.goal)
            share = min(1.0, 1.0 / left) if left else 0.0
            north, east = (p + share * (g - p) for p, g in zip(self.position, order.goal, strict=True))
            self.position = north, east
        self.signals["battery"] -= self.drain
        if order.state == "charging work":
            self.signals["battery"] = min(1.0, self.signals["battery"] + 0.05)
        if order.state == "acquisition work":
            self.signals["data"] = min(1.0, self.signals["data"] + 0.05)
        self.time += SECOND
        return order

    def run(self, seconds: int = 2000) -> None:
        while not self.scheduler.is_finished and seconds:
            self.step()
            seconds -= 1


def states(scheduler: Scheduler) -> list[str]:
    return [state for _, state in scheduler.log]


def test_the_three_tasks_run_and_the_vehicle_returns_home() -> None:
    """The vehicle has a fresh battery, acquires, transmits once there are data and returns home; it never charges."""
    world = World(Scheduler(MISSION), drain=0.0)
    world.run()
    assert states(world.scheduler) == [
        "idle", "acquisition travel", "acquisition work", "idle", "transmission travel", "transmission work", "idle",
        "home", "done",
    ]  # fmt: skip
    assert world.scheduler.finished == ["acquisition", "transmission"]
    assert math.dist(world.position, (0.0, 0.0)) <= MISSION.tolerance
    spent = {state: time for time, state in reversed(world.scheduler.log)}
    travelled = (spent["acquisition work"] - spent["acquisition travel"]) / SECOND
    assert travelled == pytest.approx(math.dist((0.0, 0.0), (53.0, 13.0)), abs=2.5)
    assert spent["done"] / SECOND == pytest.approx(54.6 + 30 + 50.3 + 20 + 48.4, abs=10.0)


def test_a_low_battery_interrupts_a_task_which_then_restarts() -> None:
    world = World(Scheduler(MISSION), drain=0.008)
    world.signals["battery"] = 0.9  # below 0.3 after 75 s, at work far out
    world.run()
    phases = states(world.scheduler)
    first = phases.index("charging travel")
    assert phases[first - 1] == "acquisition work"
    assert phases[first + 1 : first + 4] == ["charging work", "idle", "acquisition travel"]
    others = [name for name in world.scheduler.finished if name != "charging"]
    assert others == ["acquisition", "transmission"]
    assert phases[-1] == "done"
    assert world.signals["battery"] > 0.0


def test_ready_tasks_run_by_priority_then_distance() -> None:
    tasks = (
        Task("far", (40.0, 0.0), 1.0),
        Task("near", (10.0, 0.0), 1.0),
        Task("urgent", (0.0, 30.0), 1.0, priority=1),
    )
    world = World(Scheduler(Mission((0.0, 0.0), tasks)))
    world.run()
    assert world.scheduler.finished == ["urgent", "near", "far"]


def test_a_timed_task_starts_on_time_and_the_vehicle_waits_in_place_before() -> None:
    late = Task("late", (5.0, 0.0), 2.0, after=50.0)
    world = World(Scheduler(Mission((0.0, 0.0), (late,))))
    world.position = (9.0, 9.0)
    for _ in range(50):
        assert world.step() == TaskGoal("", "idle", None)
    assert world.position == (9.0, 9.0)
    assert world.step() == TaskGoal("late", "late travel", (5.0, 0.0))
    world.run()
    assert world.scheduler.finished == ["late"]
    assert world.step().state == "done"


def test_only_an_urgent_task_of_higher_priority_interrupts() -> None:
    doing = Task("doing", (0.0, 0.0), 20.0, priority=1)
    better = Task("better", (0.0, 1.0), 1.0, "late > 0", priority=5)
    rushed = Task("rushed", (0.0, 2.0), 1.0, "late > 0", priority=1, urgent=True)
    alarm = Task("alarm", (0.0, 3.0), 1.0, "alarm > 0", priority=2, urgent=True)
    scheduler = Scheduler(Mission((0.0, 0.0), (doing, better, rushed, alarm)))
    for second in range(3):
        scheduler.step(second * SECOND, (0.0, 0.0), {})
    assert scheduler.step(3 * SECOND, (0.0, 0.0), {"late": 1.0}).state == "doing work"
    # the alarm interrupts, although a ready task of higher priority may not
    assert scheduler.step(4 * SECOND, (0.0, 0.0), {"late": 1.0, "alarm": 1.0}).task == "alarm"


def test_a_task_that_becomes_ready_on_the_way_home_is_done() -> None:
    scheduler = Scheduler(Mission((0.0, 0.0), (Task("once", (9.0, 0.0), 0.0), CHARGING)))
    scheduler.step(0, (9.0, 0.0), {"battery": 1.0})
    for second in range(1, 6):
        order = scheduler.step(second * SECOND, (9.0, 0.0), {"battery": 1.0})
    assert order.state == "home"
    assert order.goal == (0.0, 0.0)
    assert scheduler.step(9 * SECOND, (9.0, 0.0), {"battery": 0.2}).state == "charging travel"


def test_a_mission_file_is_read(tmp_path: Any) -> None:
    path = os.path.join(tmp_path, "mission.toml")
    text = """
home = [0.0, 0.0]

[[task]]
name = "charging"
at = [5.0, 5.0]
duration = "1 min"
when = "battery < 0.3"
priority = 2
urgent = true
repeat = true

[[task]]
name = "acquisition"
at = [53.0, 13.0]
duration = 30

[[task]]
name = "transmission"
at = [15.0, 46.0]
duration = 20
when = "data > 0.9"
needs = ["acquisition"]
"""
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)
    read, from_record = World(Scheduler(load(path, Mission)), drain=0.008), World(Scheduler(MISSION), drain=0.008)
    assert read.scheduler.signals == {"battery", "data"}
    read.run()
    from_record.run()
    assert read.scheduler.log == from_record.scheduler.log
    with open(path, "w", encoding="utf-8") as file:
        file.write(text.replace('"acquisition"]', '"aquisition"]'))
    with pytest.raises(ConfigError, match=r"needs 'aquisition', which is not another task; did you mean"):
        Scheduler(load(path, Mission), path)


@given(st.floats(allow_nan=False), st.floats(-100.0, 100.0).map(lambda x: round(x, 3)))
def test_conditions_compare_as_python_does(value: float, number: float) -> None:
    for sign, truth in (
        ("<", value < number),
        ("<=", value <= number),
        (">", value > number),
        (">=", value >= number),
        ("==", value == number),
        ("!=", value != number),
    ):
        condition = Condition(f"x {sign} {number} and y > 0", "here")
        assert condition.holds({"x": value, "y": 1.0}) is truth
        assert not condition.holds({"x": value, "y": 0.0})
        assert not condition.holds({"y": 1.0})  # x has not been received yet
    assert Condition("", "here").holds({})


@pytest.mark.parametrize(
    ("tasks", "message"),
    [
        ((ACQUISITION, ACQUISITION), "two tasks are named"),
        ((ACQUISITION._replace(name="home"),), "cannot be named 'home'"),
        ((ACQUISITION._replace(repeat=True),), "repeat for ever"),
        ((ACQUISITION._replace(needs=("acquisition",)),), "needs 'acquisition'"),
        ((ACQUISITION._replace(needs=("b",)),
          Task("b", (0.0, 0.0), 1.0, needs=("acquisition",))), "need each other: acq"),
        ((ACQUISITION._replace(when="battery low"),), "task 'acquisition': 'battery low' is no comparison"),
    ],
)  # fmt: skip
def test_contradicting_missions_are_refused(tasks: tuple[Task, ...], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Scheduler(Mission((0.0, 0.0), tasks))
