"""Parameters of a vehicle's node that belong to parts of its simulation: those of a tether."""

from types import SimpleNamespace
from typing import Any

import pytest

from hil.common.errors import ConfigError
from hil.slave.ros.parameters import MAX, Parameters, _is_below, read_failures
from sim.tether import TetherKeys
from sim.vehicle.failures import Failure

DOUBLE, STRING = 3, 4


class FakeTether:
    """A tether that has a length and a pull only."""

    length, tension, keys = 20.0, 3.5, TetherKeys(20.0)

    def set_length(self, length: float) -> None:
        self.length = length


def call_services(tether: FakeTether | None) -> Any:
    """Return a function that calls a parameter service, and the lists of what was reported and published."""
    failures = list[Failure]()
    simulation = SimpleNamespace(tether=tether, failures=lambda _: failures[1:])
    stamps = SimpleNamespace(wall_ns=lambda now: now)
    publisher = SimpleNamespace(stamps=stamps, publish=lambda topic, _: reports.append(topic))
    source = SimpleNamespace(pilot=None)
    loop: Any = SimpleNamespace(
        simulation=simulation, source=source, sample_publisher=publisher, fail=lambda *new: failures.extend(new)
    )
    reports: list[str] = []
    services = Parameters(loop, "uuv1", {"bow": "bow"}, reports.append).services()
    return lambda name, **request: services[name][1](request), reports


def parameter(name: str, value: float | str) -> dict[str, Any]:
    kind, key = (STRING, "string_value") if isinstance(value, str) else (DOUBLE, "double_value")
    return {"name": name, "value": {"type": kind, key: value}}


def test_a_tethers_length_can_be_set_and_its_pull_read() -> None:
    tether = FakeTether()
    call, reports = call_services(tether)
    names = ["tether.length", "tether.tension"]
    assert call("list_parameters", prefixes=["tether"], depth=0)["result"]["names"] == names
    assert [v["double_value"] for v in call("get_parameters", names=names)["values"]] == [20.0, 3.5]
    assert call("get_parameter_types", names=[*names, "failures.bow", "x"])["types"] == [DOUBLE, DOUBLE, STRING, 0]
    assert [d["read_only"] for d in call("describe_parameters", names=names)["descriptors"]] == [False, True]
    assert call("set_parameters", parameters=[parameter(names[0], 25.0)])["results"] == [{"successful": True}]
    failure = 'kind = "off"; kind = "noisy", noise = 0.2'
    assert call("set_parameters", parameters=[parameter("failures.bow", failure)])["results"] == [{"successful": True}]
    assert call("get_parameters", names=["failures.bow"])["values"][0]["string_value"] == failure
    assert (tether.length, reports[:2]) == (25.0, ["parameter: tether.length: 25 m", "/parameter_events"])
    for count in (MAX, MAX + 1):
        many = [parameter(names[0], 30.0)] * count
        assert call("set_parameters_atomically", parameters=many)["result"]["successful"] == (count == MAX)


def test_invalid_values_are_refused_with_a_reason() -> None:
    call, reports = call_services(FakeTether())
    for value, message in (
        (parameter("tether.tension", 1.0), "tether.tension: it is measured"),
        (parameter("tether.length", "long"), "tether.length: expected a number like 20.0"),
        (parameter("tether.lenght", 1.0), "did you mean 'tether.length'"),
        (parameter("tether.length", 1e9), "tether: length 1e+09 m"),
    ):
        (result,) = call("set_parameters", parameters=[value])["results"]
        assert not result["successful"]
        assert message in result["reason"]
    assert not reports


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("kind = off, kind = off", "'kind' is given twice"),
        ("kind = off, thruster = nose", "'thruster' is not for parameters"),
        ("kind", "'kind' is not KEY = VALUE"),
        ("kind = off; " * 400, "characters, at most"),
    ],
)
def test_a_wrong_failure_of_a_thruster_is_refused(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        read_failures(text, "nose", "failures.nose")


def test_without_a_tether_there_are_no_parameters() -> None:
    call, _ = call_services(None)
    assert call("list_parameters", prefixes=[], depth=0)["result"]["names"] == ["failures.bow"]
    assert call("get_parameters", names=["tether.length"])["values"] == [{}]


@pytest.mark.parametrize(
    ("name", "prefixes", "depth", "is_below"),
    [
        ("a", [], 1, True), ("a.b", [], 1, False), ("a.b", [], 2, True), ("a.b.c.d", [], 0, True),
        ("a.b", ["a"], 1, True), ("a.b.c", ["a"], 1, False), ("a.b.c", ["a"], 2, True), ("a.b.c.d", ["a"], 0, True),
        ("a", ["a"], 1, True), ("ab.c", ["a"], 1, False), ("b.c", ["a", "b"], 1, True),
    ],
)  # fmt: skip
def test_parameters_are_listed_below_their_prefixes_so_deep(
    name: str, prefixes: list[str], depth: int, is_below: bool
) -> None:
    assert _is_below(name, prefixes, depth) == is_below
