"""Axes of a gamepad whose layout SDL does not have: a trigger, which rests at -1, never counts as a stick."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from hil.view.teleop.gamepad import UNPLUGGED, Gamepad


def gamepad(axes: Sequence[float], buttons: Sequence[int]) -> Gamepad:
    gamepad = Gamepad.__new__(Gamepad)
    gamepad._pygame = SimpleNamespace(event=SimpleNamespace(get=list))
    gamepad._known, gamepad.problem = None, ""
    gamepad._pad = SimpleNamespace(
        get_numaxes=lambda: len(axes),
        get_axis=axes.__getitem__,
        get_numbuttons=lambda: len(buttons),
        get_button=buttons.__getitem__,
    )
    return gamepad


@pytest.mark.parametrize(
    ("axes", "expected"),
    [
        ((0.5, -1.0, 0.25, 0.75), (1.0, 0.25, 0.75, 0.5)),  # two sticks alone
        ((0.5, -1.0, -1.0, 0.25, 0.75, -1.0), (1.0, 0.25, 0.75, 0.5)),  # a trigger behind each stick
        ((0.1, -0.05, -1.0, 0.0, 0.1, -1.0), (0.0, 0.0, 0.0, 0.0)),  # at rest
        ((0.5, -1.0), (1.0, 0.0, 0.0, 0.5)),  # one stick
    ],
)
def test_the_axes_are_mapped_without_triggers(axes: Sequence[float], expected: Sequence[float]) -> None:
    found: dict[str, Any] = gamepad(axes, [0] * 4 + [1]).message()
    assert tuple(found["axes"][name] for name in ("surge", "sway", "heave", "yaw")) == expected
    assert found["held"]


def test_only_a_shoulder_button_is_the_switch() -> None:
    assert [gamepad((0.0,) * 4, [n == number for n in range(8)]).message()["held"] for number in range(8)] == [
        number in (4, 5) for number in range(8)
    ]


def test_an_unplugged_gamepad_counts_as_released() -> None:
    pad = gamepad((0.0, -1.0), [1] * 8)
    pad.problem = UNPLUGGED
    message = pad.message()
    assert message["held"] is False
    assert not any(message["axes"].values())
