"""A rosbridge client subscribes to a real slave, and with the token commands it and calls its services."""

import contextlib
import json
import random
import time
from collections.abc import Iterator
from struct import unpack
from typing import Any

import cbor2
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect
from websockets.sync.connection import Connection
from websockets.typing import Origin

from hil.ros import encoders as ros
from tests.support.clients.rosbridge import served_vehicle
from tests.support.processes import wait_for

PATIENCE_S = 60


class Bridge:
    """One client, which stores what comes in order."""

    def __init__(self, socket: Connection) -> None:
        self.socket = socket
        self._number = 0

    def send(self, op: str, **values: Any) -> None:
        self.socket.send(json.dumps({"op": op, **values}))

    def receive(self, op: str, **expected: Any) -> Any:
        """Return the next message of this kind with these values."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            data = self.socket.recv(PATIENCE_S)
            message = json.loads(data) if isinstance(data, str) else cbor2.loads(data)
            if message["op"] == op and expected.items() <= message.items():
                return message
        raise AssertionError(f"no {op} came")

    def call(self, name: str, /, **args: Any) -> Any:
        self._number += 1
        self.send("call_service", id=f"call{self._number}", service=name, args=args)
        return self.receive("service_response", id=f"call{self._number}")


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Provide the address with its token, of a vehicle that is there."""
    with served_vehicle(tmp_path_factory.mktemp("rosbridge")) as address:
        yield address


@pytest.fixture
def bridge(address: str) -> Iterator[Bridge]:
    with connect(address, max_size=None) as socket:
        yield Bridge(socket)


@pytest.fixture
def read_only_bridge(address: str) -> Iterator[Bridge]:
    """Provide a client without the token."""
    with connect(address.partition("?")[0]) as socket:
        yield Bridge(socket)


def test_topics_are_sent_as_json(read_only_bridge: Bridge) -> None:
    read_only_bridge.send("subscribe", topic="/uuv1/odom", type="nav_msgs/Odometry")
    message = read_only_bridge.receive("publish", topic="/uuv1/odom")["msg"]
    assert message["child_frame_id"] == "base_link"
    assert message["pose"]["pose"]["position"]["z"] < 0.0
    read_only_bridge.send("unsubscribe", topic="/uuv1/odom")
    read_only_bridge.send("subscribe", topic="/clock")
    for _ in range(10):
        read_only_bridge.receive("publish", topic="/clock")


def test_topics_are_sent_as_cbor_and_as_raw_bytes(read_only_bridge: Bridge) -> None:
    read_only_bridge.send("subscribe", topic="/uuv1/imu", compression="cbor", id="a")
    message = read_only_bridge.receive("publish", topic="/uuv1/imu")["msg"]
    covariance = message["linear_acceleration_covariance"]
    assert covariance.tag == 86
    assert unpack("<9d", covariance.value)[0] > 0.0
    assert message["linear_acceleration"]["z"] == pytest.approx(9.8, abs=1.0)
    read_only_bridge.send("unsubscribe", topic="/uuv1/imu", id="a")
    read_only_bridge.send("subscribe", topic="/uuv1/pressure", compression="cbor-raw")
    raw = read_only_bridge.receive("publish", topic="/uuv1/pressure")["msg"]
    sample = ros.decode_pressure(raw["bytes"])
    assert sample is not None
    assert abs(raw["secs"] - time.time()) < PATIENCE_S


def test_the_robot_description_is_sent_to_each_subscriber(read_only_bridge: Bridge) -> None:
    read_only_bridge.send("subscribe", topic="/uuv1/robot_description")
    assert "<robot" in read_only_bridge.receive("publish", topic="/uuv1/robot_description")["msg"]["data"]
    read_only_bridge.send("subscribe", topic="/uuv1/robot_description")  # again, of a server that has it already
    read_only_bridge.receive("publish", topic="/uuv1/robot_description")


def test_commands_move_the_vehicle_and_services_answer(bridge: Bridge) -> None:
    bridge.send("subscribe", topic="/uuv1/ground_truth")
    bridge.send("advertise", topic="/uuv1/cmd_vel", type="geometry_msgs/Twist")

    def is_driven() -> bool:
        bridge.send("publish", topic="/uuv1/cmd_vel", msg={"linear": {"x": 0.5}})
        speed: float = bridge.receive("publish", topic="/uuv1/ground_truth")["msg"]["twist"]["twist"]["linear"]["x"]
        return speed > 0.3

    assert wait_for(is_driven)
    answer = bridge.call("/uuv1/arm", data=False)
    assert answer["result"]
    assert answer["values"]["success"]
    assert bridge.call("/uuv1/arm", data=True)["values"]["message"] == "armed: commands are executed"
    state = bridge.call("/uuv1/get_entity_state", entity="uuv1")["values"]
    assert state["result"]["result"] == 1
    assert state["state"]["header"]["frame_id"] == "map"


def test_wrong_requests_are_reported(bridge: Bridge) -> None:
    cases: list[tuple[str, dict[str, Any], str]] = [
        ("publish", {"topic": "/uuv1/odom", "msg": {}}, "takes commands"),
        ("publish", {"topic": "/uuv1/cmd_vel", "msg": {"linear": 1}}, "expected an object"),
        ("advertise", {"topic": "/uuv1/cmd_vel", "type": "std_msgs/String"}, "has the type geometry_msgs/msg/Twist"),
        ("subscribe", {"topic": "/uuv1/odom", "type": "std_msgs/String"}, "has the type nav_msgs/msg/Odometry"),
        ("subscribe", {"topic": "/uuv1/odom", "compression": "png"}, "none of none, cbor, cbor-raw"),
        ("subscribe", {"topic": 3}, "expected a name"),
        ("advertise_service", {"service": "/mine"}, "has it not"),
        ("fly", {}, "no operation"),
    ]
    for op, values, message in cases:
        bridge.send(op, id="x", **values)
        status = bridge.receive("status", id="x")
        assert (status["level"], message in status["msg"]) == ("error", True), status
    refused = bridge.call("/uuv1/nothing")
    assert (refused["result"], "no server for" in refused["values"]) == (False, True)
    assert not bridge.call("/rosapi/nothing")["result"]


def test_commands_and_web_pages_need_the_token(read_only_bridge: Bridge, address: str) -> None:
    for op, values in (
        ("publish", {"topic": "/uuv1/cmd_vel", "msg": {}}),
        ("advertise", {"topic": "/uuv1/cmd_vel", "type": "a/B"}),
    ):
        read_only_bridge.send(op, **values)
        assert "token" in read_only_bridge.receive("status")["msg"]
    assert "token" in read_only_bridge.call("/uuv1/arm", data=False)["values"]
    with pytest.raises(InvalidStatus), connect(address.partition("?")[0], origin=Origin("http://evil.example")):
        pass
    with connect(address, origin=Origin("http://page.example")):
        pass


def test_rosapi_lists_topics_services_and_parameters(read_only_bridge: Bridge) -> None:
    def values(name: str, /, **args: Any) -> Any:
        answer = read_only_bridge.call(f"/rosapi/{name}", **args)
        assert answer["result"], answer
        return answer["values"]

    topics = values("topics")
    assert dict(zip(topics["topics"], topics["types"], strict=True))["/uuv1/imu"] == "sensor_msgs/msg/Imu"
    assert values("topic_type", topic="/uuv1/cmd_vel")["type"] == "geometry_msgs/msg/Twist"
    assert "/uuv1/odom" in values("topics_for_type", type="nav_msgs/Odometry")["topics"]
    assert "/uuv1/arm" in values("services")["services"]
    assert values("service_type", service="/uuv1/arm")["type"] == "std_srvs/srv/SetBool"
    assert "/uuv1/arm" in values("services_for_type", type="std_srvs/SetBool")["services"]
    assert "/uuv1" in values("nodes")["nodes"]
    node = values("node_details", node="/uuv1")
    assert "/uuv1/imu" in node["publishing"]
    assert "/uuv1/cmd_vel" in node["subscribing"]
    assert "/uuv1/arm" in node["services"]
    assert values("publishers", topic="/uuv1/imu")["publishers"] == ["/uuv1"]
    assert values("message_details", type="geometry_msgs/Twist")["typedefs"][1]["fieldnames"] == ["x", "y", "z"]
    assert values("service_request_details", type="std_srvs/SetBool")["typedefs"][0]["fieldnames"] == ["data"]
    assert values("service_response_details", type="std_srvs/SetBool")["typedefs"][0]["fieldnames"][0] == "success"
    raw = values("topics_and_raw_types")
    assert len(raw["typedefs_full_text"]) == len(raw["topics"])
    assert "/uuv1:gains.surge.p" in values("get_param_names")["names"]
    assert float(values("get_param", name="/uuv1:gains.surge.p")["value"]) > 0.0
    assert abs(values("get_time")["time"]["sec"] - time.time()) < PATIENCE_S
    refused = read_only_bridge.call("/rosapi/set_param", name="/uuv1:gains.surge.p", value="2.0")
    assert not refused["result"]
    assert "token" in refused["values"]


@pytest.mark.parametrize("name", ["/uuv1:gains.surge.p", "/uuv1/gains.surge.p"])
def test_rosapi_sets_parameters(bridge: Bridge, name: str) -> None:
    before = float(bridge.call("/rosapi/get_param", name=name)["values"]["value"])
    answer = bridge.call("/rosapi/set_param", name=name, value=str(before + 1.0))
    assert answer["values"] == {"successful": True, "reason": ""}
    assert float(bridge.call("/rosapi/get_param", name=name)["values"]["value"]) == before + 1.0
    for value, reason in (("2.0.0", "value: not JSON"), ('"high"', "gains.surge.p")):
        answer = bridge.call("/rosapi/set_param", name=name, value=value)
        assert not answer["result"]
        assert reason in answer["values"]


def random_message(source: random.Random) -> str:
    """Return any text, or a request with fields of any kind."""
    text = "".join(chr(source.randrange(1, 0xD800)) for _ in range(source.randrange(40)))
    values = [None, source.randrange(-(1 << 70), 1 << 70), text[:8], "/uuv1/odom", "/rosapi/topics", [text], {text: 1}]
    keys = ("topic", "type", "service", "id", "msg", "args", "throttle_rate", "compression")
    chosen = {key: source.choice(values) for key in keys if source.random() < 0.5}
    op = source.choice(("subscribe", "unsubscribe", "advertise", "publish", "call_service", "set_level", "x"))
    return text if source.random() < 0.3 else json.dumps({"op": op, **chosen})


def test_random_text_does_not_end_the_connection(read_only_bridge: Bridge) -> None:
    source = random.Random(1)
    for _ in range(60):
        read_only_bridge.socket.send(random_message(source))
        assert read_only_bridge.call("/rosapi/get_ros_version")["values"]["version"] == 2


def test_a_message_that_is_too_large_ends_its_connection_only(read_only_bridge: Bridge, bridge: Bridge) -> None:
    with contextlib.suppress(OSError, ConnectionClosed):  # it may be closed before all of it is sent
        read_only_bridge.socket.send(json.dumps({"op": "publish", "msg": "x" * (2 << 20)}))
    assert bridge.call("/rosapi/get_ros_version")["result"]
