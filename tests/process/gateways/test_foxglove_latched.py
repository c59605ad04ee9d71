"""Messages that are sent once reach Foxglove clients that connect later."""

import json

from websockets.sync.client import connect
from websockets.typing import Subprotocol

from hil.gateways.foxglove.server import FoxgloveServer
from hil.recording.mcap_file import Message

TIME_NS = 1_700_000_000_000_000_000
STATIC = Message("/tf_static", "tf2_msgs/msg/TFMessage", 1, TIME_NS, TIME_NS, b"\0\1\0\0\0\0\0\0")
IMU = Message("/uuv1/imu", "sensor_msgs/msg/Imu", 1, TIME_NS, TIME_NS, b"\0\1\0\0old")


def received(port: int, second_server: FoxgloveServer) -> dict[int, bytes]:
    """Return the payloads that a client gets by its subscriptions, of which 0 is of the transforms and 1 of the imu."""
    with connect(f"ws://127.0.0.1:{port}", subprotocols=[Subprotocol("foxglove.sdk.v1")]) as socket:
        channels: dict[str, int] = {}
        while len(channels) < 2:
            message = socket.recv(30)
            if isinstance(message, str) and json.loads(message)["op"] == "advertise":
                channels |= {channel["topic"]: channel["id"] for channel in json.loads(message)["channels"]}
        wanted = [{"id": 0, "channelId": channels[STATIC.topic]}, {"id": 1, "channelId": channels[IMU.topic]}]
        socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        payloads: dict[int, bytes] = {}
        while 0 not in payloads:
            data = socket.recv(30)
            if isinstance(data, bytes) and data[0] == 1:  # opcode, subscription, time, payload
                payloads.setdefault(int.from_bytes(data[1:5], "little"), data[13:])
        second_server.show([IMU._replace(data=b"\0\1\0\0new")])
        while 1 not in payloads:
            data = socket.recv(30)
            if isinstance(data, bytes) and data[0] == 1:
                payloads.setdefault(int.from_bytes(data[1:5], "little"), data[13:])
    return payloads


def test_static_transforms_reach_clients_that_connect_later() -> None:
    with FoxgloveServer("127.0.0.1", 0) as view:
        view.show([STATIC, IMU])
        for _ in range(2):  # one after the other
            assert received(view.port, view) == {0: STATIC.data, 1: b"\0\1\0\0new"}, "what comes often is not repeated"
