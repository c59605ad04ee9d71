"""Task scheduler of a mission: select tasks by time, signals and priority, travel to them, return home.

A mission is a list of tasks, in Python or in a TOML file:

    home = [0.0, 0.0]

    [[task]]
    name = "charging"
    at = [5.0, 5.0]
    duration = "60 s"
    when = "battery < 0.3"
    urgent = true
    repeat = true

The states are those of the reference platform's template in Stateflow: idle, home, done, and for each task travel and
work. A step makes at most one transition. Of the tasks that are ready, the one of highest priority is next; of tasks
with equal priority, the nearest. An urgent task interrupts tasks of lower priority, which are restarted later.
"""

import operator
from collections.abc import Callable, Mapping, Sequence
from math import dist
from typing import Annotated, NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import Range, nearest

Metres = Annotated[float, Range(-1e5, 1e5, "m")]
Point = tuple[float, float]

_OWN = ("idle", "home", "done")
_COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq, "!=": operator.ne,
}  # fmt: skip


class Task(NamedTuple):
    """Task of `duration` s `at` a place (m north, m east).

    A task is ready when the comparisons of signals in `when` are true, `after` s of the mission have passed and all
    tasks in `needs` are done. A task with `repeat` becomes ready again whenever `when` is true; the mission does not
    wait for it.
    """

    name: str
    at: tuple[Metres, Metres]
    duration: Annotated[float, Range(0.0, 1e6, "s")]
    when: str = ""
    after: Annotated[float, Range(0.0, 1e7, "s")] = 0.0
    needs: tuple[str, ...] = ()
    priority: Annotated[int, Range(-1000, 1000)] = 0
    urgent: bool = False
    repeat: bool = False


class Mission(NamedTuple):
    """Tasks of a mission, and the `home` to return to after them. A place is reached within `tolerance` m."""

    home: tuple[Metres, Metres]
    task: tuple[Task, ...]
    tolerance: Annotated[float, Range(0.01, 100.0, "m")] = 0.8


class TaskGoal(NamedTuple):
    """Present `task` ("" for none), its `state`, and the `goal` to go to (m north, m east; None to stay)."""

    task: str
    state: str
    goal: Point | None


class Condition:
    """Comparisons of signals with numbers, joined by "and": `battery < 0.2 and depth > 3`.

    `signals` has the names of the signals in it. Raises ConfigError whose text begins with `where`.
    """

    def __init__(self, text: str, where: str) -> None:
        self._parts: list[tuple[str, Callable[[float, float], bool], float]] = []
        for term in text.split(" and ") if text else ():
            try:
                name, sign, number = term.split()
                self._parts.append((name, _COMPARISONS[sign], float(number)))
            except (ValueError, KeyError):
                raise ConfigError(f'{where}: {term!r} is no comparison; write "battery < 0.2 and depth > 3"') from None
        self.signals = frozenset(name for name, _, _ in self._parts)

    def holds(self, signals: Mapping[str, float]) -> bool:
        """Return whether all comparisons are true. A comparison of an unknown signal is false."""
        return all(name in signals and compare(signals[name], number) for name, compare, number in self._parts)


class Scheduler:
    """Run a mission. `log` has the time (ns) and name of every state entered. `is_finished`: at home after all tasks.

    Raises ConfigError whose text begins with `where`.
    """

    def __init__(self, mission: Mission, where: str = "mission") -> None:
        _check(mission, where)
        self.log: list[tuple[int, str]] = []
        self.finished: list[str] = []
        self._mission = mission
        self._ready = {task.name: Condition(task.when, f"{where}: task {task.name!r}") for task in mission.task}
        self._state = ""
        self._task: Task | None = None
        self._entered = self._began = 0  # ns

    @property
    def is_finished(self) -> bool:
        """True once the mission is over."""
        return self._state == "done"

    @property
    def signals(self) -> frozenset[str]:
        """Names of all signals that the mission uses."""
        return frozenset(name for condition in self._ready.values() for name in condition.signals)

    def step(self, time: int, position: Sequence[float], signals: Mapping[str, float]) -> TaskGoal:
        """Return the goal at `time` (ns, increasing) and `position` (m north, m east; other values are ignored)."""
        if not self._state:
            self._began = time
            self._enter("idle", time)
        if not self.is_finished:
            self._transit(time, (position[0], position[1]), signals)
        return TaskGoal(self._task.name if self._task else "", self._state, self._goal())

    def _transit(self, time: int, point: Point, signals: Mapping[str, float]) -> None:
        """Make the transition that is due, if any."""
        goal, task = self._goal(), self._task
        has_arrived = goal is not None and dist(point, goal) <= self._mission.tolerance
        ready = [each for each in self._mission.task if self._is_ready(each, time, signals)]
        if self._state == "home" and has_arrived:
            self._enter("done", time)
        elif ready:
            following = min(ready, key=lambda each: (-each.priority, dist(point, each.at)))
            self._enter(f"{following.name} travel", time, following)
        elif self._state == "idle" and all(each.repeat or each.name in self.finished for each in self._mission.task):
            self._enter("home", time)
        elif task and self._state == f"{task.name} travel" and has_arrived:
            self._enter(f"{task.name} work", time, task)
        elif task and self._state == f"{task.name} work" and time - self._entered >= round(task.duration * 1e9):
            self.finished.append(task.name)
            self._enter("idle", time)

    def _enter(self, state: str, time: int, task: Task | None = None) -> None:
        self._state, self._task, self._entered = state, task, time
        self.log.append((time, state))

    def _goal(self) -> Point | None:
        if self._state == "home":
            return self._mission.home
        return self._task.at if self._task else None

    def _is_ready(self, task: Task, time: int, signals: Mapping[str, float]) -> bool:
        doing = self._task
        return (
            (doing is None or (task.urgent and task.priority > doing.priority))
            and (task.repeat or task.name not in self.finished)
            and all(name in self.finished for name in task.needs)
            and time - self._began >= round(task.after * 1e9)
            and self._ready[task.name].holds(signals)
        )


def _check(mission: Mission, where: str) -> None:
    names = [task.name for task in mission.task]
    for task in mission.task:
        if task.name in _OWN or not task.name:
            raise ConfigError(f"{where}: a task cannot be named {task.name!r}; that is a state of every mission")
        if names.count(task.name) > 1:
            raise ConfigError(f"{where}: two tasks are named {task.name!r}; rename one")
        if task.repeat and not task.when:
            raise ConfigError(f"{where}: the task {task.name!r} would repeat for ever; give it a when")
        for other in task.needs:
            if other not in names or other == task.name:
                raise ConfigError(
                    f"{where}: the task {task.name!r} needs {other!r}, which is not another task{nearest(other, names)}"
                )
    remaining = list(mission.task)
    while remaining:
        waiting = [task for task in remaining if any(other.name in task.needs for other in remaining)]
        if len(waiting) == len(remaining):
            names_remaining = ", ".join(task.name for task in remaining)
            raise ConfigError(f"{where}: tasks need each other: {names_remaining}; remove a need of one of them")
        remaining = waiting
