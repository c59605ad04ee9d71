"""What a web page of any origin can do at Foxglove's bridge: look, as the library checks no origin, and no more."""

import json
from typing import Any

from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from hil.commands.gateways.foxglove import EXAMPLES, LiveView
from hil.recording.mcap_file import Message
from tests.support.processes import free_port

TIME_NS = 1_700_000_000_000_000_000
IMU = Message("/uuv1/imu", "sensor_msgs/msg/Imu", 1, TIME_NS, TIME_NS, b"\0\1\0\0")
PAGE = Origin("https://somewhere.example")


def messages(socket: Any, last: str) -> list[dict[str, Any]]:
    """What the server says until a message of that kind."""
    found: list[dict[str, Any]] = []
    while not found or found[-1]["op"] != last:
        told = socket.recv(30)
        if isinstance(told, str):
            found.append(json.loads(told))
    return found


def test_a_page_of_any_origin_can_look() -> None:
    """If this fails, the library has learnt to refuse: say so in docs/explanation/security.md."""
    port = free_port()
    with (
        LiveView("127.0.0.1", port) as view,
        connect(f"ws://127.0.0.1:{port}", subprotocols=[Subprotocol("foxglove.sdk.v1")], origin=PAGE) as socket,
    ):
        view.show(IMU)
        assert [channel["topic"] for channel in messages(socket, "advertise")[-1]["channels"]] == [IMU.topic]
    assert "any web page" in EXAMPLES, "and the help says so"


def test_a_client_can_only_look() -> None:
    port = free_port()
    with (
        LiveView("127.0.0.1", port) as view,
        connect(f"ws://127.0.0.1:{port}", subprotocols=[Subprotocol("foxglove.sdk.v1")]) as socket,
    ):
        (info,) = messages(socket, "serverInfo")
        assert info["capabilities"] == [], "not clientPublish, services, parameters or assets"
        channel = {"id": 7, "topic": "/uuv1/cmd_vel", "encoding": "cdr", "schemaName": "geometry_msgs/msg/Twist"}
        socket.send(json.dumps({"op": "advertise", "channels": [channel]}))
        status = messages(socket, "status")[-1]
        assert "not support" in status["message"] or "clientPublish" in status["message"], status
        view.show(IMU)
