"""What the buttons of the page do, and what they refuse."""

import json
from types import SimpleNamespace
from typing import Any

import pytest

from hil.common.errors import ConfigError
from hil.view.feed import Feed
from hil.view.panels.actions import OBSERVES, Actions
from hil.view.sources.paced_time import PacedTime
from hil.view.sources.source import Source


class Recording:
    """A stand-in for the recorder."""

    state, fails = "", False

    def start(self) -> str:
        if self.fails:
            raise ConfigError("disk full")
        self.state = "0 messages into there"
        return "recording into there"

    def stop(self) -> str:
        self.state = ""
        return "7 messages recorded: there"


class Vehicle:
    """A stand-in for the handle of a vehicle: it stores its commands."""

    name = "uuv1"

    def __init__(self) -> None:
        self.commands: list[Any] = []

    def __getattr__(self, command: str) -> Any:
        return lambda *values, **named: self.commands.append((command, values, named))


@pytest.fixture
def vehicle() -> Vehicle:
    return Vehicle()


@pytest.fixture
def source(vehicle: Vehicle) -> Any:
    own = SimpleNamespace(names=["uuv1"], vehicle=lambda _: vehicle, recorder=Recording(), playback=None)
    own.take_over = lambda name, on: Source.take_over(own, name, on)  # type: ignore[arg-type]
    return own


@pytest.fixture
def actions(source: Any) -> Actions:
    return Actions(source, Feed())


def log(actions: Actions) -> list[str]:
    return [text for _, _, text in json.loads(actions._feed.changes(0)[1])["log"]]


def test_a_recording_is_started_reported_and_ended(actions: Actions, source: Any) -> None:
    for _ in range(2):
        assert not actions.run("uuv1", {"do": "record"})
    source.recorder.fails = True
    assert actions.run("uuv1", {"do": "record"}) == "record: disk full"
    assert log(actions) == ["recording into there", "7 messages recorded: there", "record: disk full"]


def test_a_hold_is_commanded_and_shown_until_the_vehicle_is_let_go(actions: Actions, vehicle: Vehicle) -> None:
    assert not actions.run("uuv1", {"do": "hold", "depth": 3.0, "heading": 270.0, "speed": None})
    assert vehicle.commands == [("drive", (0.0,), {"depth": 3.0, "heading": pytest.approx(-1.5708, abs=1e-4)})]
    assert actions.targets["uuv1"]["depth"] == 3.0
    assert not actions.run("uuv1", {"do": "release"})
    assert actions.targets["uuv1"] == {}


@pytest.mark.parametrize(
    "act",
    [
        {"do": "hold", "depth": "deep", "heading": None},
        {"do": "go", "north": float("nan"), "east": 0.0, "depth": 1.0},
        {"do": "go", "north": True, "east": 0.0, "depth": 1.0},
        {"do": "follow", "points": [[1.0, 2.0]], "speed": 0.4},
        {"do": "follow", "points": [], "speed": 0.4},
        {"do": "follow", "points": [[1.0, 2.0, 3.0]], "speed": 0.0},
        {"do": "pose", "north": [], "east": 0.0, "depth": 1.0, "heading": 0.0},
        {"do": "fail", "thruster": "bow", "kind": "efficiency"},
        {"do": "time", "paused": True},
        {"do": "take"},
    ],
)
def test_what_is_no_number_or_not_possible_commands_nothing(
    actions: Actions, vehicle: Vehicle, act: dict[str, Any]
) -> None:
    assert actions.run("uuv1", act)
    assert vehicle.commands == []
    assert not actions.run("uuv1", {"do": "unknown"})


def test_an_observer_is_told_so(actions: Actions, source: Any) -> None:
    source.vehicle = lambda _: None
    assert actions.run("uuv1", {"do": "still"}) == f"still: {OBSERVES}"


def test_time_is_paused_stepped_and_sped_up(actions: Actions, source: Any) -> None:
    source.playback = playback = PacedTime(10.0, lambda: 0)
    actions.run("", {"do": "time", "paused": True, "seek": 4.0, "speed": 5.0})
    actions.run("", {"do": "time", "step": True})
    assert playback.paused
    assert (playback.time, playback.speed) == pytest.approx((4.05, 5.0))
