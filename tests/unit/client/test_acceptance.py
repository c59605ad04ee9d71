"""A client waits before it reports that a vehicle refuses its commands, by a clock of the test."""

import pytest

from hil.client import client as module
from hil.client.client import REFUSED_NS, VehicleClient
from hil.common.clock import NS_PER_S
from hil.common.errors import NetworkError
from hil.ros.diagnostics import Diagnostics


class Vehicle(VehicleClient):
    """A client without a session, of a vehicle that refuses commands until `accepts_ns`."""

    def __init__(self, accepts_ns: int, commanded: bool = False) -> None:
        self.now = 0
        self.accepts_ns = accepts_ns
        self.commanded = commanded

    @property
    def has_commanded(self) -> bool:
        return self.commanded

    @property
    def in_doubt(self) -> bool:
        return False

    def diagnostics(self) -> Diagnostics:
        return Diagnostics({"armed": "true"})

    def unavailable_reason(self) -> str:
        return "" if self.now >= self.accepts_ns else "uuv1 is commanded by another master"

    def pass_time(self, seconds: float) -> None:
        self.now += round(seconds * NS_PER_S)


@pytest.fixture
def vehicle_class(monkeypatch: pytest.MonkeyPatch) -> "type[Vehicle]":
    vehicles: list[Vehicle] = []
    monkeypatch.setattr(module, "now_ns", lambda: vehicles[-1].now)

    class Started(Vehicle):
        def __init__(self, accepts_ns: int, commanded: bool = False) -> None:
            super().__init__(accepts_ns, commanded)
            vehicles.append(self)

    return Started


def test_a_short_refusal_is_not_reported(vehicle_class: type[Vehicle]) -> None:
    vehicle = vehicle_class(REFUSED_NS - NS_PER_S)
    vehicle.require_acceptance(pause=vehicle.pass_time)
    assert REFUSED_NS - NS_PER_S <= vehicle.now < REFUSED_NS


def test_a_lasting_refusal_is_raised_with_its_reason(vehicle_class: type[Vehicle]) -> None:
    vehicle = vehicle_class(10 * REFUSED_NS)
    with pytest.raises(NetworkError, match="is commanded by another master"):
        vehicle.require_acceptance(pause=vehicle.pass_time)
    assert REFUSED_NS <= vehicle.now < REFUSED_NS + NS_PER_S


def test_a_client_that_has_commanded_reports_a_refusal_at_once(vehicle_class: type[Vehicle]) -> None:
    vehicle = vehicle_class(10 * REFUSED_NS, commanded=True)
    with pytest.raises(NetworkError):
        vehicle.require_acceptance(pause=vehicle.pass_time)
    assert vehicle.now == 0


def test_other_reasons_and_interrupts_end_the_wait(vehicle_class: type[Vehicle]) -> None:
    vehicle = vehicle_class(0)
    with pytest.raises(NetworkError, match="of its own"):
        vehicle.require_acceptance(lambda: "a reason of its own", vehicle.pass_time)

    def interrupt(_: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        vehicle_class(REFUSED_NS).require_acceptance(pause=interrupt)
