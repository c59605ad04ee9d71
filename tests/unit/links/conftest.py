"""Fixtures: wires that are closed after a test, and the clock of wires with faults."""

from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from tests.support.links.faulty_wires import Clock
from tests.support.links.link_contract import nothing_leaks


@pytest.fixture
def opened() -> Iterator[ExitStack]:
    """Close what a test opens, and check that nothing leaks."""
    with nothing_leaks(), ExitStack() as stack:
        yield stack


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr("hil.links.wires.faults.now_ns", clock)
    return clock
