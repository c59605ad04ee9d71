"""Determinism over a million steps; `tests.process.sim.test_determinism` has fewer steps."""

from tests.process.sim.test_determinism import check_repeats


def test_a_million_steps_repeat_bit_for_bit() -> None:
    check_repeats(1_000_000)  # 42 minutes at 400 Hz
