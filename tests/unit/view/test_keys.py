"""Keys of a terminal as a stick, by times that the test gives."""

from hil.view.teleop.keys import HELD_NS, Keys

NOW = 10**12


def test_a_key_is_held_while_it_repeats() -> None:
    keys = Keys()
    assert keys.message(NOW)["held"] is False
    keys.press("w", NOW)
    keys.press("d", NOW + 1000)
    assert keys.message(NOW + HELD_NS)["axes"] == {"surge": 1.0, "yaw": 1.0}
    assert keys.message(NOW + HELD_NS + 500)["axes"] == {"yaw": 1.0}
    keys.press("w", NOW + HELD_NS)
    assert keys.message(NOW + 2 * HELD_NS) == {
        "held": True, "axes": {"surge": 1.0}, "mode": "velocity", "hold_depth": True, "hold_heading": True,
    }  # fmt: skip
    assert keys.message(NOW + 2 * HELD_NS + 1)["held"] is False


def test_opposite_keys_replace_each_other_and_space_stops() -> None:
    keys = Keys()
    keys.press("w", NOW)
    keys.press("s", NOW)
    assert keys.message(NOW)["axes"] == {"surge": -1.0}
    keys.press("r", NOW)
    keys.press("?", NOW)
    keys.press(" ", NOW)
    assert keys.message(NOW)["held"] is False
    keys.press("m", NOW)
    assert keys.message(NOW)["mode"] == "effort"
