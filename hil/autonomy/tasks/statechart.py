"""Hierarchical state charts: states, and transitions between them by events, signals and time.

The semantics are Stateflow's where it offers a choice. A step makes at most one transition. Transitions of outer states
are tried before those of inner states; those of one state, in the order in which they are written. States are left from
the inside out and entered from the outside in, down to each state's `initial` part. A transition from a state to itself
leaves and enters it. Parallel states, history and actions are not supported: the caller acts on the states that `step`
returns.
"""

import operator
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Annotated, NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import Range, nearest

_COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq, "!=": operator.ne,
}  # fmt: skip


class State(NamedTuple):
    """A state. `parent` is the state that it is part of, if any; `initial` the part that is entered first, if any."""

    name: str
    parent: str = ""
    initial: str = ""


class Transition(NamedTuple):
    """Transition on an `event`, if the condition `when` is true and the source state has been active for `after` s."""

    source: str
    target: str
    event: str = ""
    when: str = ""
    after: Annotated[float, Range(0.0, 1e7, "s")] | None = None


class Change(NamedTuple):
    """States that a step exited and entered, in that order."""

    exited: tuple[str, ...] = ()
    entered: tuple[str, ...] = ()


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


class Chart:
    """A chart in one of its states. The caller gives the time in ns.

    `signals` and `events` have the names of all signals and events that the transitions use. Raises ConfigError whose
    text begins with `where` if the chart is not consistent.
    """

    def __init__(self, initial: str, states: Sequence[State], transitions: Sequence[Transition], where: str) -> None:
        self._states = {state.name: state for state in states}
        _check(initial, states, transitions, where)
        self._initial = initial
        self._transitions: dict[str, list[tuple[Transition, Condition]]] = {name: [] for name in self._states}
        for transition in transitions:
            condition = Condition(transition.when, f"{where}: transition from {transition.source!r}")
            self._transitions[transition.source].append((transition, condition))
        self.signals = frozenset(name for row in self._transitions.values() for _, c in row for name in c.signals)
        self.events = frozenset(transition.event for transition in transitions if transition.event)
        self.active: tuple[str, ...] = ()
        self._since: dict[str, int] = {}

    @property
    def state(self) -> str:
        """Innermost active state; empty before the start."""
        return self.active[-1] if self.active else ""

    def start(self, time: int) -> Change:
        """Enter the initial state at `time` ns; return the states that were entered."""
        self.active = ()
        return self._enter((), self._initial, time)

    def step(self, time: int, signals: Mapping[str, float], events: Collection[str] = ()) -> Change:
        """Make the first transition that is due at `time` (ns) by its event, signals and time; return the change."""
        for depth, name in enumerate(self.active):
            for transition, condition in self._transitions[name]:
                if self._due(transition, time, events) and condition.holds(signals):
                    return self._enter(self._common(depth, transition.target), transition.target, time)
        return Change()

    def _due(self, transition: Transition, time: int, events: Collection[str]) -> bool:
        if transition.event and transition.event not in events:
            return False
        return transition.after is None or time - self._since[transition.source] >= round(transition.after * 1e9)

    def _common(self, depth: int, target: str) -> tuple[str, ...]:
        """Return the active states that are not left: those outside of both the source, at `depth`, and the target."""
        above = _line(self._states, target)[:-1]
        staying = [a for a, b in zip(self.active[:depth], above, strict=False) if a == b]
        return tuple(staying)

    def _enter(self, staying: tuple[str, ...], target: str, time: int) -> Change:
        exited = self.active[len(staying) :][::-1]
        line = _line(self._states, target)
        while self._states[line[-1]].initial:
            line.append(self._states[line[-1]].initial)
        entered = tuple(line[len(staying) :])
        self.active = tuple(line)
        self._since.update(dict.fromkeys(entered, time))
        return Change(exited, entered)


def _line(states: Mapping[str, State], name: str) -> list[str]:
    """Return a state and all its parents, the outermost first."""
    line = [name]
    while states[line[0]].parent:
        line.insert(0, states[line[0]].parent)
    return line


def _check(initial: str, states: Sequence[State], transitions: Sequence[Transition], where: str) -> None:
    names = [state.name for state in states]
    for state in states:
        if names.count(state.name) > 1:
            raise ConfigError(f"{where}: two states are named {state.name!r}; rename one")
    named = [initial, *(t.source for t in transitions), *(t.target for t in transitions)]
    named += [name for state in states for name in (state.parent, state.initial) if name]
    for name in named:
        if name not in names:
            raise ConfigError(f"{where}: no state {name!r}{nearest(name, names)}")
    for state in states:
        _check_family(state, {state.name: state for state in states}, where)
    for transition in transitions:
        if not transition.event and not transition.when and transition.after is None:
            raise ConfigError(f"{where}: the transition from {transition.source!r} needs an event, when or after")


def _check_family(state: State, states: Mapping[str, State], where: str) -> None:
    """Raise ConfigError if parents form a circle, or if a state with parts has no initial part."""
    above, visited = state.parent, {state.name}
    while above:
        if above in visited:
            raise ConfigError(f"{where}: the state {state.name!r} is part of itself; give it another parent, or none")
        visited.add(above)
        above = states[above].parent
    parts = [part.name for part in states.values() if part.parent == state.name]
    if (parts or state.initial) and state.initial not in parts:
        raise ConfigError(f"{where}: the state {state.name!r} needs one of its own parts as its initial one: {parts}")
