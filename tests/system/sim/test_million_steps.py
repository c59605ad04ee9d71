"""Determinism over a million steps; `tests.process.sim.test_determinism` has fewer."""

from tests.process.sim.test_determinism import check_repeats


def test_a_million_steps() -> None:
    check_repeats(1_000_000)  # 42 minutes at 400 Hz
