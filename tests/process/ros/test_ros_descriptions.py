"""Descriptions and commands of a slave by the topics that tools of ROS 2 use."""

import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.client.client import VehicleClient
from hil.common.clock import now_ns, to_wall_ns
from hil.network.roles import open_master_session
from hil.network.services import call
from hil.network.session import Session
from hil.ros import encoders
from hil.ros import message as ros_message
from hil.ros.gid import gid_of
from hil.ros.graph import Node, read_token
from hil.ros.topics import DESCRIPTIONS, TOPICS, Topic
from tests.support.processes import Program, running_slave, wait_for, write_scenario

PUBLISHERS = "@ros2_lv/*/*/*/*/MP/**"


@pytest.fixture(scope="module")
def slave(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Program, str]]:
    with running_slave(tmp_path_factory.mktemp("described")) as started:
        yield started


class Listener:
    """A node that subscribes to a topic as rmw_zenoh does: token and advanced subscriber."""

    def __init__(self, session: Session, topic: Topic) -> None:
        self.received: list[Any] = []
        self._type = topic.type  # known before the first message comes
        name = topic.full_name("uuv1")
        Node(session, f"listener_{topic.name.strip('/')}").subscribes(topic, "uuv1")
        session.subscribe_keys(f"0{name}/*/*", self._deliver, 10, topic.qos.latched)

    def _deliver(self, _key: str, payload: bytes, _attachment: bytes) -> None:
        self.received.append(ros_message.decode(self._type, payload))

    def first(self) -> Any:
        return wait_for(lambda: self.received[0] if self.received else None)


@pytest.mark.parametrize("name", DESCRIPTIONS)
def test_descriptions_are_sent_to_the_first_and_to_late_subscribers(slave: tuple[Program, str], name: str) -> None:
    program, endpoint = slave
    for _ in range(2):
        with open_master_session(endpoint) as session:
            message = Listener(session, TOPICS[name]).first()
            assert message, program.output
            if name == "robot_description":
                assert '<joint name="front_right" type="continuous">' in message["data"]
            elif name == "map":
                assert set(message["data"]) <= {0, 100}
                assert len(message["data"]) == message["info"]["width"] * message["info"]["height"]
            else:
                assert message == {"markers": []}  # the pool is empty


def test_a_master_of_all_topics_does_not_cause_descriptions(tmp_path: Path) -> None:
    scenario, port = write_scenario(tmp_path)
    with Program(tmp_path, "slave", scenario) as program:
        program.expect("ready")
        with VehicleClient(f"tcp/127.0.0.1:{port}", "uuv1") as client:
            assert wait_for(lambda: client.latest.get("odom"))
            assert not set(DESCRIPTIONS) & set(client.latest)
            assert client.malformed == 0


def test_an_endpoint_has_the_gid_of_its_messages(slave: tuple[Program, str]) -> None:
    """As ROS computes the one of the other: `ros2 topic info -v` and the gid of a message's info are the same."""
    sent: dict[str, bytes] = {}

    def note(key: str, _payload: bytes, attachment: bytes) -> None:
        stamp = encoders.unpack_attachment(attachment)
        sent[key] = stamp.gid if stamp else b""

    with open_master_session(slave[1]) as session, VehicleClient(slave[1], "uuv1") as master:
        session.subscribe_keys("0/**", note, 100)
        assert wait_for(lambda: len(sent) > 10 and any("/diagnostics/" in key for key in sent))
        master.command(VelocityCommand(surge=0.1, depth=2.0))
        assert wait_for(lambda: master.diagnostics().commanded_by)
        assert master.diagnostics().commands_refused == 0  # two publishers, one master
        sent |= {each.key: each.gid for each in master._publishers.values()}
        announced = {}
        for token in (*session.tokens(PUBLISHERS), *master.session.tokens(PUBLISHERS)):
            entity = read_token(token)
            assert entity
            announced[encoders.data_key(0, entity.topic, entity.type, entity.type_hash)] = gid_of(token)
    assert sent == {key: announced[key] for key in sent}


def _armed(lines: Listener) -> Any:
    return next((each for each in lines.received if each["msg"].startswith("arm: ")), None)


def test_lines_of_the_log_are_published_on_rosout(slave: tuple[Program, str]) -> None:
    with open_master_session(slave[1]) as session:
        call(session, "/uuv1/arm", "std_srvs/srv/SetBool", {"data": True})
        for _ in range(2):  # the second subscriber is late, and gets the last line
            lines = Listener(session, TOPICS["/rosout"])
            line = wait_for(partial(_armed, lines))
            assert line
            assert (line["name"], line["level"]) == ("uuv1", 20)
            assert line["msg"] == "arm: armed: commands are executed"
            assert line["stamp"]["sec"] > 1e9


def test_diagnostics_are_published_on_the_standard_topic(slave: tuple[Program, str]) -> None:
    with open_master_session(slave[1]) as session:
        message = Listener(session, TOPICS["/diagnostics"]).first()
    (status,) = message["status"]
    assert status["name"] == "uuv1: slave"
    assert {"loop_rate_hz", "commands_received"} <= {pair["key"] for pair in status["values"]}


def test_setting_a_parameter_publishes_an_event(slave: tuple[Program, str]) -> None:
    with open_master_session(slave[1]) as session:
        listener = Listener(session, TOPICS["/parameter_events"])
        assert Listener(session, TOPICS["/clock"]).first()  # by then the services are known here
        value = {"type": 3, "double_value": 2.5}
        parameter = {"name": "gains.surge.p", "value": value}
        reply = call(
            session, "/uuv1/set_parameters", "rcl_interfaces/srv/SetParameters", {"parameters": [parameter]}, 20.0
        )
        assert reply["results"][0]["successful"]
        event = listener.first()
    assert event["node"] == "/uuv1"
    (changed,) = event["changed_parameters"]
    assert (changed["name"], changed["value"]["double_value"]) == ("gains.surge.p", 2.5)
    assert not event["new_parameters"]
    assert not event["deleted_parameters"]


def test_a_stamped_velocity_moves_the_vehicle(slave: tuple[Program, str]) -> None:
    twist = {"linear": {"x": 0.4}, "angular": {}}
    topic = TOPICS["cmd_vel_stamped"]
    with open_master_session(slave[1]) as session:
        truth = Listener(session, TOPICS["ground_truth"])
        publisher = session.publisher("uuv1", topic)
        payload = ros_message.encode(topic.type, {"header": {"frame_id": "base_link"}, "twist": twist})

        def speed() -> bool:
            publisher.put(payload, to_wall_ns(now_ns()))
            time.sleep(0.04)
            return bool(truth.received) and truth.received[-1]["twist"]["twist"]["linear"]["x"] > 0.3

        assert wait_for(speed)


def test_a_stamped_velocity_on_the_plain_topic_is_malformed(slave: tuple[Program, str]) -> None:
    """The message begins with a time, which must not be decoded as velocities."""
    topic = TOPICS["cmd_vel_stamped"]._replace(name="cmd_vel")
    with open_master_session(slave[1]) as session:
        health = Listener(session, TOPICS["diagnostics"])
        publisher = session.publisher("uuv1", topic)
        payload = ros_message.encode(topic.type, {"twist": {"linear": {"x": 0.4}}})

        def malformed() -> bool:
            publisher.put(payload, to_wall_ns(now_ns()))
            time.sleep(0.04)
            pairs = (
                {pair["key"]: pair["value"] for pair in health.received[-1]["status"][0]["values"]}
                if health.received
                else {}
            )
            return int(pairs.get("commands_malformed", 0)) > 0

        assert wait_for(malformed)
