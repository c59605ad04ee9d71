"""A slave, a fleet and a vehicle of the Python interface, for its tests."""

from collections.abc import Iterator
from pathlib import Path

import pytest

import hil
from hil.client.fleet import Fleet
from hil.client.vehicle_handle import Vehicle
from tests.support.processes import Program, running_slave, slave_with


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Provide one slave for all tests that do not change it."""
    with slave_with(tmp_path_factory.mktemp("slave"), "altimeter = { rate = 5 }\nleak = { rate = 2 }") as endpoint:
        yield endpoint


@pytest.fixture
def fleet(endpoint: str) -> Iterator[Fleet]:
    with hil.connect(endpoint, wait=60.0) as fleet:
        yield fleet


@pytest.fixture
def vehicle(fleet: Fleet) -> Vehicle:
    return fleet["uuv1"]


@pytest.fixture
def own_slave(tmp_path: Path) -> Iterator[tuple[Program, str]]:
    with running_slave(tmp_path) as started:
        yield started
