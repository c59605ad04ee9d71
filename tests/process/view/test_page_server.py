"""The live view's web server: connections without the token, and stalled browsers."""

import base64
import http.client
import select
import socket
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from typing import Any

import pytest

from hil.common.web import http_server
from hil.view import page_server
from hil.view.feed import Feed
from hil.view.page_server import PageServer
from tests.support.processes import wait_for

TOKEN = "a-token"


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> Iterator[PageServer]:
    monkeypatch.setattr(http_server, "REQUEST_S", 1.0)
    monkeypatch.setattr(http_server, "MAX_CONNECTIONS", 8)
    with PageServer("127.0.0.1", 0, TOKEN, b"", Feed(), answer_stick) as served:
        yield served


def answer_stick(_: int, values: Mapping[str, Any] | None) -> Mapping[str, Any]:
    return {"shown": "x" * (values or {}).get("bytes", 0)}


def connect(served: PageServer) -> socket.socket:
    return socket.create_connection(("127.0.0.1", served.port), 30)


def is_closed(connection: socket.socket) -> bool:
    """Return True if the other end has closed it; received bytes are discarded."""
    connection.setblocking(False)
    try:
        while connection.recv(4096):
            pass
    except BlockingIOError:
        return False
    except ConnectionError:
        pass
    return True


def status(served: PageServer, path: str) -> int:
    with ExitStack() as stack:
        connection = http.client.HTTPConnection("127.0.0.1", served.port, timeout=30)
        stack.callback(connection.close)
        connection.request("GET", path)
        return connection.getresponse().status


def test_connections_without_the_token_are_limited_in_number_and_time(served: PageServer) -> None:
    with ExitStack() as stack:
        silent = [stack.enter_context(connect(served)) for _ in range(40)]
        assert wait_for(lambda: sum(map(is_closed, silent)) >= 32), "all but eight at once"
        assert wait_for(lambda: all(map(is_closed, silent))), "and the others soon"
        assert status(served, f"/?token={TOKEN}") == 302


def test_a_connection_with_the_token_stays_open(served: PageServer) -> None:
    request = f"GET /?token={TOKEN} HTTP/1.1\r\nHost: x\r\n\r\n".encode()
    with connect(served) as admitted, connect(served) as silent:
        admitted.sendall(request)
        assert wait_for(lambda: is_closed(silent))
        admitted.settimeout(30)
        admitted.sendall(request)
        assert admitted.recv(4096).startswith(b"HTTP/1.1 302")


def test_a_browser_that_does_not_read_is_disconnected(served: PageServer, monkeypatch: pytest.MonkeyPatch) -> None:
    """A connection that is closed normally would stay as long as the kernel tries to send the rest."""
    monkeypatch.setattr(page_server, "STALLED_S", 0.5)
    ended = select.poll()
    with socket.socket() as browser:
        browser.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)  # so that little waits in the kernel
        browser.connect(("127.0.0.1", served.port))
        key = base64.b64encode(bytes(16)).decode()
        browser.sendall(
            f"GET /stick?token={TOKEN} HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        browser.settimeout(30)
        assert browser.recv(256).startswith(b"HTTP/1.1 101")
        text = b'{"bytes": 33554432}'
        browser.sendall(bytes((0x81, 0x80 | len(text), 0, 0, 0, 0)) + text)
        ended.register(browser, 0)
        assert ended.poll(60_000), "the connection is still there"


@pytest.mark.parametrize("token", ["%ff", "%ed%a0%80", "", "a-token-and-more"])
def test_any_other_token_is_refused(served: PageServer, token: str) -> None:
    assert status(served, f"/?token={token}") == 403


@pytest.mark.parametrize("token", [b"wrong", b"\xc3\xa9"], ids=["wrong", "no HTTP"])
def test_a_refused_connection_is_closed_without_a_traceback(
    served: PageServer, caplog: pytest.LogCaptureFixture, token: bytes
) -> None:
    with connect(served) as outsider:
        outsider.sendall(b"GET /?token=" + token + b" HTTP/1.1\r\nHost: x\r\n\r\n")
        assert wait_for(lambda: is_closed(outsider))
    assert caplog.records == []
