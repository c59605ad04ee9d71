"""Rights to read and to command at the gateway for Foxglove."""

import json
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

from hil.gateways.foxglove.server import FoxgloveServer
from hil.gateways.websocket_server import MAX_CLIENTS
from hil.recording.mcap_file import Message

TIME_NS = 1_700_000_000_000_000_000
IMU = Message("/uuv1/imu", "sensor_msgs/msg/Imu", 1, TIME_NS, TIME_NS, b"\0\1\0\0")
PAGE = Origin("https://somewhere.example")


@pytest.fixture
def server() -> Iterator[FoxgloveServer]:
    with FoxgloveServer("127.0.0.1", 0) as opened:
        yield opened


def opened(server: FoxgloveServer, query: str = "", **options: Any) -> ClientConnection:
    address, protocols = f"ws://127.0.0.1:{server.port}/{query}", [Subprotocol("foxglove.sdk.v1")]
    socket: ClientConnection = connect(address, subprotocols=protocols, **options)
    return socket


def messages(socket: Any, last: str) -> list[dict[str, Any]]:
    """Return the messages of the server up to the first of that kind."""
    messages: list[dict[str, Any]] = []
    while not messages or messages[-1]["op"] != last:
        received = socket.recv(30)
        if isinstance(received, str):
            messages.append(json.loads(received))
    return messages


def test_a_web_page_needs_the_token_even_to_read(server: FoxgloveServer) -> None:
    for query in ("", "?token=wrong", "?token="):
        with pytest.raises(InvalidStatus) as refused:
            opened(server, query, origin=PAGE)
        assert refused.value.response.status_code == 403
    server.show([IMU])
    with opened(server, f"?token={server.access.token}", origin=PAGE) as socket:
        assert [channel["topic"] for channel in messages(socket, "advertise")[-1]["channels"]] == [IMU.topic]


def test_a_client_without_token_can_only_read(server: FoxgloveServer) -> None:
    with opened(server) as socket:
        (info,) = messages(socket, "serverInfo")
        assert set(info["capabilities"]) == {"time", "connectionGraph", "assets"}, "nothing that commands"
        channel = {"id": 7, "topic": "/uuv1/cmd_vel", "encoding": "cdr", "schemaName": "geometry_msgs/msg/Twist"}
        for request in (
            json.dumps({"op": "advertise", "channels": [channel]}),
            json.dumps({"op": "setParameters", "parameters": [{"name": "/uuv1/gains.surge.p", "value": 1.0}]}),
            b"\x01\x07\0\0\0" + b"\0" * 52,
            b"\x02\0\0\0\0\0\0\0\0\x03\0\0\0cdr",
        ):
            socket.send(request)
            assert "token" in messages(socket, "status")[-1]["message"]


def test_a_malformed_message_gets_an_error_and_the_connection_continues(server: FoxgloveServer) -> None:
    with opened(server) as socket:
        for request in (
            "{",
            "[]",
            '{"op": "subscribe"}',
            '{"op": "subscribe", "subscriptions": [{"id": -1}]}',
            b"\xff",
        ):
            socket.send(request)
            assert messages(socket, "status")[-1]["level"] == 2
        server.show([IMU])
        assert messages(socket, "advertise")


def test_the_number_of_clients_is_limited(server: FoxgloveServer) -> None:
    with ExitStack() as stack:
        for socket in [stack.enter_context(opened(server)) for _ in range(MAX_CLIENTS)]:
            messages(socket, "serverInfo")
        late_client = stack.enter_context(opened(server))
        assert late_client.recv_events is not None
        with pytest.raises(Exception, match="32 clients are here already"):
            late_client.recv(30)


def test_a_client_that_does_not_read_loses_old_messages_and_does_not_block_others(server: FoxgloveServer) -> None:
    picture = IMU._replace(topic="/uuv1/camera/image_raw", type="sensor_msgs/msg/Image", data=bytes(4 << 20))
    server.show([picture])
    with opened(server, max_size=None, max_queue=1) as slow_client, opened(server, max_size=None) as other_client:
        for socket in (slow_client, other_client):
            number = messages(socket, "advertise")[-1]["channels"][0]["id"]
            socket.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": number}]}))
            socket.ping().wait(30)
        for _ in range(30):  # 120 MB, of which the slow client's queue holds 32
            server.show([picture])
            while not isinstance(other_client.recv(60), bytes):
                pass
        # Now it reads, and gets the reason.
        assert "dropped" in messages(slow_client, "status")[-1]["message"]
