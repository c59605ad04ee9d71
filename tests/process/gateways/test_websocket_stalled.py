"""A websocket client that does not read what it is sent is gone after a while, so that its place is free again."""

import base64
import os
import socket
from collections.abc import Iterator

import pytest

from hil.gateways import websocket_client, websocket_server
from hil.gateways.foxglove.server import FoxgloveServer
from tests.support.processes import wait_for

PATIENCE_S = 60.0
NOT_A_MESSAGE = b"\x81\x80\0\0\0\0"  # a text frame without text, which is answered


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[FoxgloveServer]:
    """Serves with room for one client, and waits half a second for those that do not read."""
    monkeypatch.setattr(websocket_client, "MOST_BYTES", 10_000)
    monkeypatch.setattr(websocket_client, "STALLED_S", 0.5)
    monkeypatch.setattr(websocket_server, "MOST_CLIENTS", 1)
    with FoxgloveServer("127.0.0.1", 0) as server:
        yield server


def open_websocket(port: int) -> socket.socket:
    """Return a socket after its handshake, to which the server has written no more than that it is there."""
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


def send_for_ever(client: socket.socket) -> None:
    """Send what is answered, until the connection is closed."""
    while True:
        client.sendall(NOT_A_MESSAGE * 64)


def test_who_sends_and_never_reads_loses_its_place(server: FoxgloveServer) -> None:
    def is_admitted() -> bool:
        with open_websocket(server.port) as other:
            return b"serverInfo" in other.recv(4096)

    with open_websocket(server.port) as client:
        with pytest.raises(ConnectionError):
            send_for_ever(client)
        assert wait_for(is_admitted)


def test_who_reads_slowly_stays(server: FoxgloveServer) -> None:
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
