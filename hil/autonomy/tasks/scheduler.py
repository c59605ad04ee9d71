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

The result is a chart (`hil.autonomy.tasks.statechart`) like the reference platform's template in Stateflow. Its states
are idle, home, done, and one for each task, with the parts travel and work. Of the tasks that are ready, the one of
highest priority is next; of tasks with equal priority, the nearest. An urgent task interrupts tasks of lower priority,
which are restarted later.
"""

from collections.abc import Mapping, Sequence
from math import dist
from typing import Annotated, NamedTuple

from hil.autonomy.tasks.statechart import Chart, Condition, State, Transition
from hil.common.errors import ConfigError
from hil.common.schema import Range, nearest

Metres = Annotated[float, Range(-1e5, 1e5, "m")]
Point = tuple[float, float]

_OWN = ("idle", "home", "done")


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


class Scheduler:
    """Run a mission. `log` has the time (ns) and name of every state entered. `is_finished`: at home after all tasks.

    Raises ConfigError whose text begins with `where`.
    """

    def __init__(self, mission: Mission, where: str = "mission") -> None:
        _check(mission, where)
        self.log: list[tuple[int, str]] = []
        self.finished: list[str] = []
        self._mission = mission
        self._tasks = {task.name: task for task in mission.task}
        self._ready = {task.name: Condition(task.when, f"{where}: task {task.name!r}") for task in mission.task}
        self._chart = _chart(mission, where)
        self._began = 0

    @property
    def is_finished(self) -> bool:
        """True once the mission is over."""
        return self._chart.state == "done"

    @property
    def signals(self) -> frozenset[str]:
        """Names of all signals that the mission uses."""
        return frozenset(name for condition in self._ready.values() for name in condition.signals)

    def step(self, time: int, position: Sequence[float], signals: Mapping[str, float]) -> TaskGoal:
        """Return the goal at `time` (ns, increasing) and `position` (m north, m east; other values are ignored)."""
        point = position[0], position[1]
        if not self._chart.active:
            self._began = time
            self._log_states(time, self._chart.start(time).entered)
        events = {self._choice(time, point, signals)}
        if self._goal() is not None and dist(point, self._goal() or point) <= self._mission.tolerance:
            events.add("arrived")
        change = self._chart.step(time, signals, events)
        if change.exited and change.entered == ("idle",):
            self.finished.append(change.exited[-1])
        self._log_states(time, change.entered)
        return TaskGoal(self._task(), self._chart.state, self._goal())

    def _log_states(self, time: int, entered: tuple[str, ...]) -> None:
        self.log += [(time, entered[-1])] if entered else []

    def _task(self) -> str:
        return self._chart.active[0] if self._chart.active[0] in self._tasks else ""

    def _goal(self) -> Point | None:
        if self._chart.state == "home":
            return self._mission.home
        task = self._tasks.get(self._task())
        return task.at if task else None

    def _choice(self, time: int, position: Point, signals: Mapping[str, float]) -> str:
        """Return the event that starts the next task or the return home; "" if there is neither."""
        ready = [task for task in self._mission.task if self._is_ready(task, time, signals)]
        if ready:
            return _start(min(ready, key=lambda task: (-task.priority, dist(position, task.at))).name)
        waiting = [task.name for task in self._mission.task if not task.repeat and task.name not in self.finished]
        return "" if waiting else "go home"

    def _is_ready(self, task: Task, time: int, signals: Mapping[str, float]) -> bool:
        doing = self._tasks.get(self._task())
        return (
            (doing is None or task in _interrupting(doing, self._mission.task))
            and (task.repeat or task.name not in self.finished)
            and all(name in self.finished for name in task.needs)
            and time - self._began >= round(task.after * 1e9)
            and self._ready[task.name].holds(signals)
        )


def _start(name: str) -> str:
    return f"start {name}"


def _interrupting(doing: Task, tasks: Sequence[Task]) -> list[Task]:
    """Return the tasks that may interrupt the task `doing`."""
    return [task for task in tasks if task.urgent and task.priority > doing.priority]


def _chart(mission: Mission, where: str) -> Chart:
    """Return the state chart: idle, home, done, and for each task a state with the parts travel and work."""
    states = [State(name) for name in _OWN]
    transitions = [Transition("idle", "home", event="go home"), Transition("home", "done", event="arrived")]
    for task in mission.task:
        travel, work = f"{task.name} travel", f"{task.name} work"
        states += [State(task.name, initial=travel), State(travel, task.name), State(work, task.name)]
        sources = ["idle", "home"]
        sources += [other.name for other in mission.task if task in _interrupting(other, mission.task)]
        transitions += [Transition(source, task.name, event=_start(task.name)) for source in sources]
        transitions.append(Transition(travel, work, event="arrived"))
        transitions.append(Transition(work, "idle", after=task.duration))
    return Chart("idle", states, transitions, where)


def _check(mission: Mission, where: str) -> None:
    names = [task.name for task in mission.task]
    for task in mission.task:
        if task.name in _OWN or not task.name:
            raise ConfigError(f"{where}: a task cannot be named {task.name!r}; that is a state of every mission")
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
