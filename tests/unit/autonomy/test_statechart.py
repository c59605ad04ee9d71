"""Hierarchical state charts: which states are left and entered, in which order, and by which event."""

import os
from typing import Any, NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.autonomy.tasks.statechart import Change, Chart, Condition, State, Transition
from hil.common.errors import ConfigError
from hil.common.schema import load

SECOND = 1_000_000_000
TEXT = """
initial = "dive"

[[state]]
name = "dive"

[[state]]
name = "survey"
initial = "line"

[[state]]
name = "line"
parent = "survey"

[[state]]
name = "turn"
parent = "survey"

[[state]]
name = "surface"

[[transition]]
source = "dive"
target = "survey"
when = "depth >= 5"

[[transition]]
source = "line"
target = "turn"
after = "10 s"

[[transition]]
source = "turn"
target = "line"
event = "turned"

[[transition]]
source = "survey"
target = "surface"
when = "battery < 0.2 and depth > 1"

[[transition]]
source = "survey"
target = "turn"
event = "wall"
when = "range < 3"
"""


class Parts(NamedTuple):
    """The parts of a chart, as parsed from a file."""

    initial: str
    state: tuple[State, ...]
    transition: tuple[Transition, ...]


@pytest.fixture
def chart(tmp_path: Any) -> Chart:
    path = os.path.join(tmp_path, "mission.toml")
    with open(path, "w", encoding="utf-8") as file:
        file.write(TEXT)
    parts = load(path, Parts)
    chart = Chart(parts.initial, parts.state, parts.transition, path)
    assert chart.state == ""
    assert chart.start(0) == Change((), ("dive",))
    return chart


def test_entering_a_composite_state_enters_its_initial_state(chart: Chart) -> None:
    assert chart.step(1, {"depth": 4.9}) == Change()
    assert chart.step(2, {"depth": 5.0}) == Change(("dive",), ("survey", "line"))
    assert chart.active == ("survey", "line")
    assert chart.step(3, {"depth": 5.0, "battery": 0.1}) == Change(("line", "survey"), ("surface",))


def test_after_counts_from_the_entry_of_the_state(chart: Chart) -> None:
    chart.step(7 * SECOND, {"depth": 6.0})
    assert chart.step(17 * SECOND - 1, {}) == Change()
    assert chart.step(17 * SECOND, {}) == Change(("line",), ("turn",))  # the survey is not left
    assert chart.step(18 * SECOND, {}, ["turned"]) == Change(("turn",), ("line",))
    assert chart.step(27 * SECOND, {}) == Change()
    assert chart.step(28 * SECOND, {}).entered == ("turn",)


def test_outer_transitions_take_precedence_then_file_order(chart: Chart) -> None:
    chart.step(0, {"depth": 6.0})
    signals = {"battery": 0.1, "depth": 6.0, "range": 2.0}
    assert chart.step(10 * SECOND, signals, ["wall"]).entered == ("surface",)


def test_a_transition_needs_both_its_event_and_its_condition(chart: Chart) -> None:
    chart.step(0, {"depth": 6.0})
    assert chart.step(1, {"range": 2.0}) == Change()
    assert chart.step(1, {"range": 4.0}, ["wall"]) == Change()
    assert chart.step(1, {"range": 2.0}, ["wall"]) == Change(("line", "survey"), ("survey", "turn"))


def test_a_chart_lists_its_signals_and_events(chart: Chart) -> None:
    assert chart.signals == {"depth", "battery", "range"}
    assert chart.events == {"turned", "wall"}


def test_a_self_transition_exits_and_enters_once_a_step() -> None:
    states = [State("a", initial="b"), State("b", "a"), State("c", "a")]
    chart = Chart(
        "a",
        states,
        [Transition("b", "b", event="again"), Transition("b", "c", event="go"), Transition("c", "b", event="go")],
        "",
    )
    chart.start(0)
    assert chart.step(1, {}, ["again"]) == Change(("b",), ("b",))
    assert chart.step(2, {}, ["go"]) == Change(("b",), ("c",))
    assert chart.step(3, {}, ["go"]) == Change(("c",), ("b",))


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


STATES = [State("a", initial="b"), State("b", "a"), State("c")]
GO = Transition("a", "c", event="go")


@pytest.mark.parametrize(
    ("initial", "states", "transitions", "message"),
    [
        ("x", STATES, [GO], "no state 'x'"),
        ("a", STATES, [Transition("a", "bb", event="go")], "no state 'bb'; did you mean 'b'"),
        ("a", [*STATES, State("c")], [GO], "two states are named 'c'; rename one"),
        ("a", [State("a"), State("b", "a")], [], r"'a' needs one of its own parts as its initial one: \['b'\]"),
        ("a", [State("a", initial="c"), State("b", "a"), State("c")], [], "needs one of its own parts"),
        ("a", [State("a", "b", "b"), State("b", "a", "a")], [], "is part of itself; give it another parent"),
        ("a", STATES, [Transition("a", "c")], "needs an event, when or after"),
        ("a", STATES, [Transition("a", "c", when="battery is low")], "chart: transition from 'a': 'battery is"),
        ("a", STATES, [Transition("a", "c", when="battery < low")], "is no comparison"),
    ],
)  # fmt: skip
def test_inconsistent_charts_are_refused_with_a_reason(
    initial: str, states: list[State], transitions: list[Transition], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        Chart(initial, states, transitions, "chart")
