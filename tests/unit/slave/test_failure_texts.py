"""Failures of thrusters as the texts of ROS parameters."""

from contextlib import suppress
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from hil.common.errors import ConfigError
from hil.slave.ros.parameters import failures_text, read_failures
from sim.vehicle.failures import Failure

FAILURES = st.one_of(
    st.just({"kind": "off"}),
    st.floats(0.0, 1.0, exclude_max=True).map(lambda x: {"kind": "efficiency", "efficiency": x}),
    st.integers(1, 2200).map(lambda x: {"kind": "stuck", "pwm_us": x}),
    st.floats(0.0, 10.0, exclude_min=True).map(lambda x: {"kind": "delayed", "delay": x}),
    st.floats(0.0, 2.0, exclude_min=True).map(lambda x: {"kind": "noisy", "noise": x}),
)


@given(st.lists(FAILURES, max_size=5, unique_by=lambda keys: str(keys["kind"])))
def test_every_shown_value_can_be_set(tables: list[dict[str, Any]]) -> None:
    """The text of any list of failures can be parsed, also the longest."""
    failures = [Failure("bow", **table) for table in tables]
    assert read_failures(failures_text(failures), "bow", "failures.bow") == failures


@given(st.text(max_size=60) | st.text('kind=off,;. "0123456789efnoisy_', max_size=60))
def test_random_text_is_refused_without_other_errors(text: str) -> None:
    with suppress(ConfigError):
        found = read_failures(text, "bow", "failures.bow")
        assert read_failures(failures_text(found), "bow", "failures.bow") == found
