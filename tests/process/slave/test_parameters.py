"""Thruster failures and controller gains as ROS parameters of a real slave: read, set, refused and repeated."""

import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.client.client import VehicleClient
from hil.network.roles import open_master_session
from hil.network.services import call
from hil.network.session import Session
from hil.recording import check as recording_check
from hil.recording.events import EVENTS, decode_event
from hil.recording.reader import read_messages
from tests.support.processes import Program, write_scenario

NAMES = ["front_right", "front_left", "rear_right", "rear_left", "vertical_right", "vertical_left"]
PARAMETERS = [f"failures.{name}" for name in NAMES]
TOP = """
[[failure]]
thruster = "vertical_left"
kind = "noisy"
noise = 0.25
[recording]
slave = true
folder = "{folder}"
keep_free = 0
"""
STRING = 4


class ParameterClient:
    """A client of a slave's parameter services, as `ros2 param` is."""

    def __init__(self, session: Session) -> None:
        self.session = session

    def call(self, name: str, kind: str, **request: Any) -> Any:
        return call(self.session, f"/uuv1/{name}", f"rcl_interfaces/srv/{kind}", request, 30.0)

    def get_value(self, name: str) -> str:
        (value,) = self.call("get_parameters", "GetParameters", names=[name])["values"]
        assert value["type"] == STRING
        return str(value["string_value"])

    def set_values(self, *pairs: tuple[str, Any], atomically: bool = False) -> Any:
        """Return the results of `name, text` pairs; a value that is no text is a ParameterValue."""
        parameters = [
            {"name": name, "value": {"type": STRING, "string_value": value} if isinstance(value, str) else value}
            for name, value in pairs
        ]
        if atomically:
            return self.call("set_parameters_atomically", "SetParametersAtomically", parameters=parameters)["result"]
        return self.call("set_parameters", "SetParameters", parameters=parameters)["results"]


class CommandedSlave:
    """A slave that is commanded and recorded, with its clients."""

    def __init__(self, slave: Program, client: VehicleClient, asker: ParameterClient, folder: Path) -> None:
        self.slave, self.client, self.asker, self.folder = slave, client, asker, folder

    def fly(self) -> None:
        for _ in range(6):
            self.client.command(VelocityCommand(surge=0.5, heave=0.1, yaw_rate=0.4))
            time.sleep(0.02)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CommandedSlave]:
    folder = tmp_path_factory.mktemp("parameters")
    scenario, port = write_scenario(folder)
    with scenario.open("a") as file:
        file.write(TOP.format(folder=folder / "recordings"))
    with Program(folder, "slave", scenario) as slave:
        slave.expect("recording into")
        with open_master_session(f"tcp/127.0.0.1:{port}") as session, VehicleClient(session, "uuv1") as client:
            assert client.wait_for_vehicle(60)
            yield CommandedSlave(slave, client, ParameterClient(session), folder)


@pytest.fixture
def asker(flown: CommandedSlave) -> ParameterClient:
    """Provide a client, with a vehicle in which all is well."""
    results = flown.asker.set_values(*[(name, "") for name in PARAMETERS])
    assert results == [{"successful": True, "reason": ""}] * len(PARAMETERS)
    return flown.asker


def test_failures_of_the_scenario_are_parameters_from_the_start(flown: CommandedSlave) -> None:
    assert flown.asker.get_value("failures.vertical_left") == 'kind = "noisy", noise = 0.25'
    assert flown.asker.get_value("failures.front_left") == ""


@pytest.mark.parametrize(
    ("request_", "names"),
    [
        ({"prefixes": ["failures"]}, PARAMETERS),
        ({"prefixes": ["failures.rear_left", "other"]}, ["failures.rear_left"]),
        ({"prefixes": ["fail"]}, []),
        ({"depth": 1}, []),
        ({"depth": 2}, PARAMETERS),
        ({"prefixes": ["failures"], "depth": 1}, PARAMETERS),
    ],
)
def test_parameters_are_listed_by_prefix(asker: ParameterClient, request_: Any, names: list[str]) -> None:
    result = asker.call("list_parameters", "ListParameters", **request_)["result"]
    assert result == {"names": names, "prefixes": ["failures"] if names else []}


def test_gains_of_the_cascade_are_numbers_that_can_be_set(asker: ParameterClient) -> None:
    names = asker.call("list_parameters", "ListParameters")["result"]["names"]
    gains = [name for name in names if name.startswith("gains.")]
    assert [name for name in names if name not in gains] == PARAMETERS
    assert {"gains.surge.p", "gains.yaw_rate.i", "gains.depth.limit"} <= set(gains)

    def set_gains(**values: float) -> list[bool]:
        rows = [
            {"name": name.replace("__", "."), "value": {"type": 3, "double_value": value}}
            for name, value in values.items()
        ]
        results = asker.call("set_parameters", "SetParameters", parameters=rows)["results"]
        return [result["successful"] for result in results]

    def read(name: str) -> float:
        (value,) = asker.call("get_parameters", "GetParameters", names=[name])["values"]
        assert value["type"] == 3
        return float(value["double_value"])

    before = read("gains.surge.p")
    assert set_gains(gains__surge__p=before + 0.5, gains__surge__i=2.5) == [True, True]
    assert (read("gains.surge.p"), read("gains.surge.i")) == (before + 0.5, 2.5)
    assert set_gains(gains__surge__p=-1.0, gains__surge__none=1.0, gains__depth__p=float("nan")) == [False] * 3
    assert read("gains.surge.p") == before + 0.5


def test_types_values_and_descriptions_are_in_the_requested_order(asker: ParameterClient) -> None:
    names = ["failures.rear_left", "use_sim_time", "failures.front_left"]
    assert asker.call("get_parameter_types", "GetParameterTypes", names=names)["types"] == bytes((STRING, 0, STRING))
    values = asker.call("get_parameters", "GetParameters", names=names)["values"]
    assert [value["type"] for value in values] == [STRING, 0, STRING]
    descriptors = asker.call("describe_parameters", "DescribeParameters", names=names)["descriptors"]
    assert [(each["name"], each["type"]) for each in descriptors] == list(zip(names, (STRING, 0, STRING), strict=True))
    assert descriptors[0]["description"] == "what is wrong with the thruster 'rear_left'"
    assert 'kind = "efficiency", efficiency = 0.5' in descriptors[0]["additional_constraints"]
    assert not descriptors[0]["read_only"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('kind = "off"', 'kind = "off"'),
        ("kind = off", 'kind = "off"'),
        ('kind = "efficiency", efficiency = 0.5', 'kind = "efficiency", efficiency = 0.5'),
        ('kind = "stuck", pwm_us = 1700', 'kind = "stuck", pwm_us = 1700'),
        ('kind = "stuck"', 'kind = "stuck"'),
        ('kind = "delayed", delay = "100 ms"', 'kind = "delayed", delay = 0.1'),
        ("kind=noisy,noise=1", 'kind = "noisy", noise = 1.0'),
        ('kind = "repaired"', ""),
        (
            'kind = "noisy", noise = 0.2; kind = "off"; kind = "noisy", noise = 0.3;',
            'kind = "noisy", noise = 0.3; kind = "off"',
        ),
        ("", ""),
    ],
)
def test_every_kind_of_failure_is_set_and_cleared(asker: ParameterClient, text: str, expected: str) -> None:
    (result,) = asker.set_values(("failures.rear_left", text))
    assert result == {"successful": True, "reason": ""}
    assert asker.get_value("failures.rear_left") == expected
    assert asker.set_values(("failures.rear_left", expected)) == [result]
    assert asker.get_value("failures.rear_left") == expected
    assert asker.get_value("failures.rear_right") == ""
    asker.set_values(("failures.rear_left", ""))
    assert asker.get_value("failures.rear_left") == ""


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("failures.rear_left", 'kind = "of"', "failures.rear_left: kind: 'of' is not one of off, efficiency"),
        ("failures.rear_left", "kind = off, efficency = 1", "no key 'efficency'; did you mean 'efficiency'?"),
        ("failures.rear_left", "kind = efficiency, efficiency = 1.5", "efficiency: 1.5 is outside 0 to 1"),
        ("failures.rear_left", "kind = efficiency", "does nothing without efficiency"),
        ("failures.rear_left", "kind = off, noise = 0.5", "noise belongs to kind 'noisy', not 'off'"),
        ("failures.rear_left", "kind = delayed, delay = 3 Hz", "delay: has the unit 'Hz'; expected one of s"),
        ("failures.rear_left", "kind = off, time = 3", "key 'time' is not for parameters"),
        ("failures.rear_left", "kind = off, kind = off", "key 'kind' is given twice"),
        ("failures.rear_left", "off", "'off' is not KEY = VALUE; write it as kind = "),
        ("failures.rear_left", "kind = off," + 200 * " ", "211 characters, at most 200"),
        ("failures.rear_left", {"type": 1, "bool_value": False}, "expected a text, such as kind = "),
        ("failures.rear_left", {"type": 0}, "expected a text, such as kind = "),
        ("failures.raer_left", "kind = off", "no parameter 'failures.raer_left'; did you mean 'failures.rear_left'?"),
        ("use_sim_time", {"type": 1, "bool_value": True}, "no parameter 'use_sim_time'"),
    ],
)
def test_wrong_values_are_refused_with_the_reason(asker: ParameterClient, name: str, value: Any, message: str) -> None:
    before = 'kind = "efficiency", efficiency = 0.25'
    valid = ("failures.front_left", "kind = off")
    asker.set_values(("failures.rear_left", before))
    first, second = asker.set_values((name, value), valid)
    assert not first["successful"]
    assert message in first["reason"]
    assert second["successful"], "the others are set"
    assert asker.get_value("failures.rear_left") == before
    asker.set_values(("failures.front_left", ""))
    refused = asker.set_values(valid, (name, value), atomically=True)
    assert refused == first
    assert asker.get_value("failures.front_left") == "", "all or none"


def test_all_parameters_are_set_atomically(asker: ParameterClient) -> None:
    texts = {name: f'kind = "efficiency", efficiency = 0.{digit}' for digit, name in enumerate(PARAMETERS, 1)}
    assert asker.set_values(*texts.items(), atomically=True) == {"successful": True, "reason": ""}
    assert {name: asker.get_value(name) for name in PARAMETERS} == texts


def test_a_failure_set_by_the_service_is_read_as_a_parameter(asker: ParameterClient) -> None:
    fail = "/uuv1/thrusters/front_right/fail"
    asker.set_values(("failures.front_right", "kind = delayed, delay = 1"))
    call(asker.session, fail, "std_srvs/srv/SetBool", {"data": True})
    assert asker.get_value("failures.front_right") == 'kind = "delayed", delay = 1.0; kind = "off"'
    call(asker.session, fail, "std_srvs/srv/SetBool", {"data": False})
    assert asker.get_value("failures.front_right") == ""


def test_parameter_changes_are_recorded_and_repeated_bit_for_bit(flown: CommandedSlave, asker: ParameterClient) -> None:
    """All kinds are set while the slave is commanded, then its recording is replayed; this ends the slave."""
    kinds = (
        "kind = efficiency, efficiency = 0.3", "kind = stuck, pwm_us = 1700", "kind = delayed, delay = 50 ms",
        "kind = noisy, noise = 0.4", "kind = off", "kind = stuck", "",
    )  # fmt: skip
    flown.fly()
    for name in ("failures.front_right", "failures.vertical_left"):
        for text in kinds:
            assert asker.set_values((name, text))[0]["successful"]
            flown.fly()
    assert flown.slave.stop(signal.SIGINT) == 0
    assert 'parameter: failures.front_right: kind = "efficiency", efficiency = 0.3' in flown.slave.output
    assert "parameter: failures.front_right: nothing is wrong" in flown.slave.output
    (recorder,) = (flown.folder / "recordings").iterdir()
    events = [decode_event(each.data) for each in read_messages(str(recorder)) if each.topic == f"/uuv1/{EVENTS.name}"]
    done = [failure["kind"] for event in events[-14:] for failure in event["fail"] if failure["kind"] != "repaired"]
    assert done == 2 * ["efficiency", "stuck", "delayed", "noisy", "off", "stuck"]
    verdict = recording_check.check(str(recorder))
    assert verdict.difference == ""
    assert verdict.compared > 100
