"""A stick moves a vehicle only while its switch is held and its messages arrive."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.view.teleop.stick import AXES, FULL, SILENT_AFTER_NS, Stick

NOW = 10**12


def message(held: bool = True, **axes: Any) -> dict[str, Any]:
    return {"held": held, "axes": axes}


def test_a_held_stick_commands_in_proportion() -> None:
    stick = Stick()
    stick.update(message(surge=0.5, sway=-1.0, heave=0.25, yaw=1.0), NOW)
    command = stick.command(NOW)
    assert command is not None
    assert command.mode == "velocity"
    assert command[1:5] == pytest.approx((0.25, -0.5, 0.075, 0.5))
    stick.update({**message(surge=1.0, yaw=-0.5), "mode": "effort"}, NOW)
    command = stick.command(NOW)
    assert command is not None
    assert (command.mode, command.surge, command.yaw) == ("effort", 40.0, -5.0)


def test_a_released_or_silent_stick_commands_nothing() -> None:
    stick = Stick()
    assert stick.command(NOW) is None, "before the first message"
    stick.update(message(held=False, surge=1.0), NOW)
    assert stick.command(NOW) is None
    stick.update(message(surge=1.0), NOW)
    assert stick.command(NOW + SILENT_AFTER_NS) is not None
    assert stick.command(NOW + SILENT_AFTER_NS + 1) is None
    assert stick.command(NOW) is None, "a stick that timed out must first send again"


@pytest.mark.parametrize(
    "broken", [{}, {"axes": None, "held": True}, message(surge="ahead"), message(surge=float("nan")), {"held": True}]
)
def test_a_malformed_message_releases_the_stick(broken: dict[str, Any]) -> None:
    stick = Stick()
    stick.update(message(surge=1.0), NOW)
    stick.update(broken, NOW)
    assert stick.command(NOW) is None
    assert stick.malformed == 1


NUMBERS = {axis: st.floats() | st.integers() for axis in AXES}
ANY = st.none() | st.booleans() | st.floats() | st.text(max_size=5) | st.lists(st.integers(), max_size=3)


@given(ANY, st.dictionaries(st.sampled_from((*AXES, "other")), ANY) | st.fixed_dictionaries(NUMBERS), ANY, ANY)
def test_any_message_is_decoded_without_an_exception(held: Any, axes: dict[str, Any], mode: Any, holds: Any) -> None:
    stick = Stick()
    stick.update({"held": held, "axes": axes, "mode": mode, "hold_depth": holds}, NOW)
    command = stick.command(NOW)
    assert command is None or all(abs(v) <= most for v, most in zip(command[1:5], FULL[command.mode], strict=True))
