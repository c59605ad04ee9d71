"""A Foxglove client with the token commands a real slave, calls its services, and reads and sets its parameters."""

import json
import re
import time
from collections import defaultdict
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from struct import pack, unpack_from
from typing import Any

import pytest
from websockets.sync.client import connect
from websockets.sync.connection import Connection
from websockets.typing import Subprotocol

from hil.client.client import VehicleClient
from hil.common.errors import ConfigError
from hil.gateways.foxglove.assets import read_asset
from hil.network.roles import open_client_session
from hil.ros import encoders as ros
from hil.ros import message as ros_message
from hil.ros.graph import Node
from hil.ros.topics import TOPICS
from tests.support.processes import Program, free_port, wait_for, write_scenario

SET_BOOL = "std_srvs/srv/SetBool"


class Foxglove:
    """A client like Foxglove: it stores the received data by topic, and what the server offers."""

    def __init__(self, socket: Connection) -> None:
        self.socket = socket
        self.channels: dict[str, int] = {}
        self.services: dict[str, dict[str, Any]] = {}
        self.data: dict[int, bytes] = {}
        self.responses: dict[int, bytes] = {}
        self.assets: dict[int, bytes] = {}
        self.times: list[int] = []
        self.texts: list[dict[str, Any]] = []

    def receive(self) -> bool:
        """Take one message in; always True."""
        message = self.socket.recv(60)
        if isinstance(message, bytes):
            number = int.from_bytes(message[1:5], "little")
            if message[0] == 1:
                self.data[number] = message[13:]
            elif message[0] == 2:
                self.times.append(int.from_bytes(message[1:], "little"))
            elif message[0] == 3:
                length = int.from_bytes(message[9:13], "little")
                self.responses[int.from_bytes(message[5:9], "little")] = message[13 + length :]
            else:
                self.assets[number] = message[5:]
            return True
        text = json.loads(message)
        self.texts.append(text)
        if text["op"] == "advertise":
            self.channels |= {channel["topic"]: channel["id"] for channel in text["channels"]}
        elif text["op"] == "advertiseServices":
            self.services |= {service["name"]: service for service in text["services"]}
        return True

    def until(self, find_value: Any) -> Any:
        """Receive until `find_value()` is true; its value."""
        value = find_value()
        while not value:
            self.receive()
            value = find_value()
        return value

    def receive_op(self, op: str) -> dict[str, Any]:
        """Return the next text of that kind."""
        self.texts.clear()
        return self.until(lambda: next((text for text in self.texts if text["op"] == op), None))  # type: ignore[no-any-return]

    def subscribe(self, topic: str) -> int:
        number: int = self.until(lambda: topic in self.channels and self.channels[topic] + 1) - 1
        self.socket.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": number, "channelId": number}]}))
        return number

    def send(self, op: str, **values: Any) -> None:
        self.socket.send(json.dumps({"op": op, **values}))

    def call(self, name: str, number: int, request: bytes, encoding: bytes = b"cdr") -> None:
        service: dict[str, Any] = self.until(lambda: self.services.get(name))
        self.socket.send(b"\x02" + pack("<III", service["id"], number, len(encoding)) + encoding + request)


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, str]]:
    """Provide the address with its token, and the endpoint of the slave."""
    folder = tmp_path_factory.mktemp("foxglove")
    path, port = write_scenario(folder)
    meshes = folder / "share" / "my_rov" / "meshes"
    meshes.mkdir(parents=True)
    (meshes.parent / "package.xml").write_text("<package><name>my_rov</name></package>")
    (meshes / "hull.stl").write_bytes(b"solid hull")
    command = ("gateway", "foxglove", "--scenario", path, "--command", "--listen", free_port())
    with (
        Program(folder, "slave", path) as slave,
        Program(folder, *command, environment={"AMENT_PREFIX_PATH": str(folder)}) as gateway,
    ):
        slave.expect("ready")
        address = gateway.expect(r"(ws://\S+) shows").group(1)
        gateway.expect("connected: uuv1")
        yield address, f"tcp/127.0.0.1:{port}"


@pytest.fixture
def foxglove(vehicle: tuple[str, str]) -> Iterator[Foxglove]:
    with connect(vehicle[0], subprotocols=[Subprotocol("foxglove.sdk.v1")], max_size=None) as socket:
        yield Foxglove(socket)


@pytest.mark.parametrize("encoding", ["cdr", "json"])
def test_the_teleop_panel_commands_the_vehicle(foxglove: Foxglove, encoding: str) -> None:
    """The panel sends 20 times a second; when it stops, the vehicle's deadman stops the thrusters."""
    odometry = foxglove.subscribe("/uuv1/odom")
    channel = {"id": 5, "topic": "/uuv1/cmd_vel", "encoding": encoding, "schemaName": "geometry_msgs/msg/Twist"}
    foxglove.send("advertise", channels=[channel])
    twist = ros.encode_twist((0.4, 0.0, 0.0), (0.0, 0.0, 0.0)) if encoding == "cdr" else b'{"linear": {"x": 0.4}}'

    def speed() -> float:
        sample = ros.decode_odometry(foxglove.data[odometry])
        return float(sample.nu[0]) if sample else 0.0

    for _ in range(2000):
        foxglove.socket.send(b"\x01" + pack("<I", 5) + twist)
        foxglove.data.pop(odometry, None)
        foxglove.until(lambda: odometry in foxglove.data)
        if speed() > 0.3:
            break
    assert speed() > 0.3
    assert foxglove.until(lambda: odometry in foxglove.data and speed() < 0.1)


def test_topics_that_no_vehicle_subscribes_to_are_refused(foxglove: Foxglove) -> None:
    for number, (topic, reason) in enumerate(
        [("/uuv1/imu", "cmd_vel"), ("/nobody/cmd_vel", "no vehicle is called 'nobody'"), ("", "cmd_vel")]
    ):
        channel = {"id": number, "topic": topic, "encoding": "cdr", "schemaName": "geometry_msgs/msg/Twist"}
        foxglove.socket.send(json.dumps({"op": "advertise", "channels": [channel]}))
        foxglove.socket.send(b"\x01" + pack("<I", number) + bytes(52))
        assert reason in foxglove.receive_op("status")["message"]


def test_services_are_called(foxglove: Foxglove, vehicle: tuple[str, str]) -> None:
    with VehicleClient(vehicle[1], "uuv1", role="observer") as client:
        for number, is_armed in enumerate((False, True)):
            foxglove.call("/uuv1/arm", number, ros_message.encode(f"{SET_BOOL}_Request", {"data": is_armed}))
            answer = foxglove.until(lambda number=number: foxglove.responses.get(number))
            response = ros_message.decode(f"{SET_BOOL}_Response", answer)
            assert response
            assert response["success"]
            assert wait_for(lambda is_armed=is_armed: client.diagnostics().armed is is_armed)  # type: ignore[misc]
    foxglove.call("/uuv1/arm", 8, b'{"data": true}', b"json")
    answer = json.loads(foxglove.until(lambda: foxglove.responses.get(8)))
    assert answer == {"success": True, "message": "armed: commands are executed"}
    foxglove.call("/uuv1/arm", 9, b'{"data": 1', b"json")
    assert "/uuv1/arm: not JSON" in foxglove.receive_op("serviceCallFailure")["message"]
    foxglove.call("/uuv1/arm", 9, b"\0\1\0\0")
    assert "not a std_srvs/srv/SetBool_Request" in foxglove.receive_op("serviceCallFailure")["message"]
    assert "ros2msg" in foxglove.services["/uuv1/arm"]["request"]["schemaEncoding"]


def test_parameters_are_read_and_set(foxglove: Foxglove) -> None:
    foxglove.socket.send(json.dumps({"op": "getParameters", "parameterNames": [], "id": "all"}))
    values = {row["name"]: row["value"] for row in foxglove.receive_op("parameterValues")["parameters"]}
    gain = values["/uuv1/gains.surge.p"]
    request = {"op": "setParameters", "parameters": [{"name": "/uuv1/gains.surge.p", "value": gain + 1.0}], "id": "set"}
    foxglove.socket.send(json.dumps(request))
    (row,) = foxglove.receive_op("parameterValues")["parameters"]
    assert row == {"name": "/uuv1/gains.surge.p", "value": gain + 1.0, "type": "float64"}
    for value, reason in (("high", "gains.surge.p"), (None, "expected a number or a text")):
        request["parameters"] = [{"name": "/uuv1/gains.surge.p", "value": value}]
        foxglove.socket.send(json.dumps(request))
        assert reason in foxglove.receive_op("status")["message"]


def test_changes_of_parameters_are_sent_to_their_subscribers(foxglove: Foxglove) -> None:
    """Updates may come after the answer, but in the order of the changes: that of `name` is the last of its value."""
    name, other = "/uuv1/gains.surge.p", "/uuv1/gains.surge.i"
    values = count(10.0, 0.125)  # above those of other tests, whose updates may be late

    def updates() -> dict[float, list[str]]:
        """Set both to a new value; return the names in the updates of each value so far."""
        value, found = next(values), defaultdict[float, list[str]](list)
        rows = [{"name": each, "value": value} for each in (other, name)]
        foxglove.send("setParameters", parameters=rows, id=str(value))
        foxglove.until(lambda: [text for text in foxglove.texts if text.get("id") == str(value)])
        for text in foxglove.texts:
            for row in text["parameters"] if text["op"] == "parameterValues" and "id" not in text else ():
                found[row["value"]].append(row["name"])
        return found

    foxglove.send("subscribeParameterUpdates", parameterNames=[name])
    assert all(names == [name] for names in foxglove.until(updates).values())
    foxglove.send("subscribeParameterUpdates", parameterNames=[])
    assert foxglove.until(lambda: [other, name] in updates().values())
    foxglove.send("unsubscribeParameterUpdates", parameterNames=[])
    later = next(values)
    for _ in range(5):
        assert max(updates()) < later


def test_the_graph_is_sent_with_its_changes(foxglove: Foxglove, vehicle: tuple[str, str]) -> None:
    foxglove.send("subscribeConnectionGraph")
    update = foxglove.receive_op("connectionGraphUpdate")
    assert {"name": "/uuv1/imu", "publisherIds": ["/uuv1"]} in update["publishedTopics"]
    assert {"name": "/uuv1/arm", "providerIds": ["/uuv1"]} in update["advertisedServices"]
    assert "/uuv1/cmd_vel" in [row["name"] for row in update["subscribedTopics"]]
    with open_client_session(vehicle[1], seconds=30.0) as session:
        Node(session, "sketch").publishes(TOPICS["plan"], "uuv1")
        update = foxglove.receive_op("connectionGraphUpdate")
        assert update["publishedTopics"] == [{"name": "/uuv1/plan", "publisherIds": ["/sketch"]}]
        assert update["advertisedServices"] == update["removedTopics"] == []
    assert foxglove.receive_op("connectionGraphUpdate")["removedTopics"] == ["/uuv1/plan"]
    foxglove.send("unsubscribeConnectionGraph")


def test_meshes_of_ros_packages_are_sent(foxglove: Foxglove) -> None:
    foxglove.send("fetchAsset", uri="package://my_rov/meshes/hull.stl", requestId=7)
    assert foxglove.until(lambda: foxglove.assets.get(7)) == b"\0\0\0\0\0solid hull"
    foxglove.send("fetchAsset", uri="package://my_rov/meshes/keel.stl", requestId=8)
    status, length = unpack_from("<BI", foxglove.until(lambda: foxglove.assets.get(8)))
    assert status == 1
    assert b"No such file" in foxglove.assets[8][5 : 5 + length]


@pytest.mark.parametrize(
    "uri",
    ["file:///etc/passwd", "package://my_rov/package.xml", "package://my_rov/../../secret.png", "/etc/secret.png",
     "package://my_rov/%2e%2e/secret.png", "package://../secret.png", "package://nobody_has_this/hull.stl"],
)  # fmt: skip
def test_other_files_are_not_sent(uri: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "ws" / "my_rov"
    package.mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>my_rov</name></package>")
    (tmp_path / "secret.png").write_bytes(b"secret")
    monkeypatch.chdir(package)
    with pytest.raises(ConfigError, match=r"only meshes and pictures|no package 'nobody_has_this'"):
        read_asset(uri)


def test_the_time_is_that_of_the_messages(foxglove: Foxglove) -> None:
    assert foxglove.until(lambda: len(foxglove.times) > 20)
    assert foxglove.times == sorted(foxglove.times)
    assert abs(foxglove.times[-1] / 1e9 - time.time()) < 60.0


def test_a_disarmed_vehicle_is_not_commanded(foxglove: Foxglove) -> None:
    channel = {"id": 1, "topic": "/uuv1/cmd_vel", "encoding": "cdr", "schemaName": "geometry_msgs/msg/Twist"}
    foxglove.socket.send(json.dumps({"op": "advertise", "channels": [channel]}))
    foxglove.subscribe("/uuv1/odom")  # so that something comes
    request = ros_message.encode(f"{SET_BOOL}_Request", {"data": False})
    foxglove.call("/uuv1/arm", 1, request)
    foxglove.until(lambda: foxglove.responses.get(1))

    def refusal() -> str:
        foxglove.socket.send(b"\x01" + pack("<I", 1) + ros.encode_twist((0.4, 0.0, 0.0), (0.0, 0.0, 0.0)))
        foxglove.receive()
        return " ".join([text["message"] for text in foxglove.texts if text["op"] == "status"])

    try:
        assert foxglove.until(lambda: re.search("uuv1 is disarmed", refusal()))
    finally:
        foxglove.call("/uuv1/arm", 2, ros_message.encode(f"{SET_BOOL}_Request", {"data": True}))
        foxglove.until(lambda: foxglove.responses.get(2))


def test_the_scene_has_the_world_and_the_vehicle(foxglove: Foxglove) -> None:
    from foxglove.messages import SceneUpdate

    number = foxglove.subscribe("/scene")
    assert len(foxglove.until(lambda: foxglove.data.get(number))) > 500
    (channel,) = [
        channel for text in foxglove.texts if text["op"] == "advertise" for channel in text["channels"]
        if channel["topic"] == "/scene"
    ]  # fmt: skip
    assert (channel["encoding"], channel["schemaName"]) == ("protobuf", SceneUpdate.get_schema().name)
