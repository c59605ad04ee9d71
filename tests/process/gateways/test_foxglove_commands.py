"""A Foxglove client with the token commands a real slave, calls its services, and reads and sets its parameters."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from struct import pack
from typing import Any

import pytest
from websockets.sync.client import connect
from websockets.sync.connection import Connection
from websockets.typing import Subprotocol

from hil.client.client import VehicleClient
from hil.ros import encoders as ros
from hil.ros import message as ros_message
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
        self.texts: list[dict[str, Any]] = []

    def receive(self) -> bool:
        """Take one message in; always True."""
        message = self.socket.recv(60)
        if isinstance(message, bytes):
            store = self.data if message[0] == 1 else self.responses
            number = int.from_bytes(message[1:5] if message[0] == 1 else message[5:9], "little")
            store[number] = message[13:] if message[0] == 1 else message[16:]
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

    def call(self, name: str, number: int, request: bytes) -> None:
        service: dict[str, Any] = self.until(lambda: self.services.get(name))
        self.socket.send(b"\x02" + pack("<III", service["id"], number, 3) + b"cdr" + request)


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, str]]:
    """Provide the address with its token, and the endpoint of the slave."""
    folder = tmp_path_factory.mktemp("foxglove")
    path, port = write_scenario(folder)
    with (
        Program(folder, "slave", path) as slave,
        Program(folder, "gateway", "foxglove", "--scenario", path, "--command", "--listen", free_port()) as gateway,
    ):
        slave.expect("ready")
        address = gateway.expect(r"(ws://\S+) shows").group(1)
        gateway.expect("connected: uuv1")
        yield address, f"tcp/127.0.0.1:{port}"


@pytest.fixture
def foxglove(vehicle: tuple[str, str]) -> Iterator[Foxglove]:
    with connect(vehicle[0], subprotocols=[Subprotocol("foxglove.sdk.v1")], max_size=None) as socket:
        yield Foxglove(socket)


def test_the_teleop_panel_commands_the_vehicle(foxglove: Foxglove) -> None:
    """The panel sends 20 times a second; when it stops, the vehicle's deadman stops the thrusters."""
    odometry = foxglove.subscribe("/uuv1/odom")
    channel = {"id": 5, "topic": "/uuv1/cmd_vel", "encoding": "cdr", "schemaName": "geometry_msgs/msg/Twist"}
    foxglove.socket.send(json.dumps({"op": "advertise", "channels": [channel]}))
    twist = ros.encode_twist((0.4, 0.0, 0.0), (0.0, 0.0, 0.0))

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


def test_the_layout_is_printed(tmp_path: Path) -> None:
    with Program(tmp_path, "gateway", "foxglove", "--layout", "uuv1", "--scenario", "paper_field") as program:
        assert program.process.wait(60) == 0
    assert json.loads(program.output)["configById"]["Teleop!stick"]["topic"] == "/uuv1/cmd_vel"
