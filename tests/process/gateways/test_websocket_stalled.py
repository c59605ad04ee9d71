"""A websocket client that does not read is disconnected after a timeout, so that another can connect."""

import asyncio
import base64
import os
import select
import socket
from collections.abc import Iterator
from typing import Any, cast

import pytest
from aiohttp import web

from hil.gateways import websocket_client, websocket_server
from hil.gateways.foxglove.server import FoxgloveServer
from hil.gateways.websocket_client import SocketClient
from hil.gateways.websocket_server import WebSocketServer
from hil.recording.mcap_file import Message
from tests.support.processes import wait_for

PATIENCE_S = 60.0
NOT_A_MESSAGE = b"\x81\x80\0\0\0\0"  # a text frame without text, which is answered
PING = b"\x89\xfd\0\0\0\0" + bytes(125)
MAX_READ = 32 << 20  # bytes that a server reads of a client that reads nothing: far more than wait in the kernel


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[FoxgloveServer]:
    """Provide a server with room for one client, which waits a fifth of a second for those that do not read."""
    monkeypatch.setattr(websocket_client, "MAX_BYTES", 10_000)
    monkeypatch.setattr(websocket_client, "STALLED_S", 0.2)
    monkeypatch.setattr(websocket_server, "MAX_CLIENTS", 1)
    monkeypatch.setattr(websocket_server, "HEARTBEAT_S", 5.0)  # serves where the kernel stops what the client sends
    with FoxgloveServer("127.0.0.1", 0) as server:
        yield server


def open_websocket(port: int) -> socket.socket:
    """Return a socket after its handshake, to which the server has written only its information."""
    client = socket.socket()
    client.settimeout(PATIENCE_S)
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)  # so that little waits in the kernel
    client.connect(("127.0.0.1", port))
    key = base64.b64encode(os.urandom(16)).decode()
    client.sendall(
        f"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: {key}"
        "\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode()
    )
    assert b"101 Switching" in client.recv(256)
    return client


@pytest.mark.parametrize("frame", [NOT_A_MESSAGE, PING], ids=["text", "ping"])
def test_a_client_that_sends_but_does_not_read_is_disconnected(server: FoxgloveServer, frame: bytes) -> None:
    def is_admitted() -> bool:
        with open_websocket(server.port) as other:
            return b"serverInfo" in other.recv(4096)

    with open_websocket(server.port) as client:
        with pytest.raises(ConnectionError):
            client.sendall(frame * (MAX_READ // len(frame)))
        assert wait_for(is_admitted)


class Idle(SocketClient):
    _on_text = _on_binary = cast(Any, None)


class WritingServer(WebSocketServer[Idle]):
    """Writes more to a client than it takes."""

    async def _serve(self, request: web.Request) -> web.StreamResponse:
        assert request.transport
        asyncio.get_running_loop().call_later(0.2, request.transport.write, bytes(1 << 25))
        return await super()._serve(request)

    def _make_client(self, socket: web.WebSocketResponse, may_command: bool) -> Idle:
        return Idle(socket)

    def _show(self, messages: list[Message]) -> None: ...


def test_a_client_that_does_not_answer_heartbeats_is_disconnected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(websocket_server, "HEARTBEAT_S", 0.5)
    ended = select.poll()
    with WritingServer("127.0.0.1", 0, "test") as server, open_websocket(server.port) as client:
        ended.register(client, 0)
        assert ended.poll(PATIENCE_S * 1e3), "the connection is still there"


def test_a_client_that_reads_slowly_stays_connected(server: FoxgloveServer) -> None:
    with open_websocket(server.port) as client:
        client.sendall(NOT_A_MESSAGE * 1000)
        received = b""
        while received.count(b"protocol") < 1000:
            data = client.recv(4096)
            assert data
            received += data


def test_bytes_that_are_not_http_leave_no_traceback(server: FoxgloveServer, caplog: pytest.LogCaptureFixture) -> None:
    for noise in (b"\0\1\2\r\n\r\n", b"POST / HTTP/1.1\r\nContent-Length: 99999999999\r\n\r\n"):
        with socket.create_connection(("127.0.0.1", server.port), PATIENCE_S) as client:
            client.sendall(noise)
            assert b"400 Bad Request" in client.recv(4096)
    assert not caplog.records
