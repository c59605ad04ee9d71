"""Every web server gets the same hostile requests of a page in a browser: none is served, and each server continues."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import psutil
import pytest

import hil
from hil.client.health_watch import HealthWatch
from hil.common.web import http_server, plain_server
from hil.common.web.access import MAX_CONNECTIONS, WebAccess
from hil.gateways.commanding import Commanding
from hil.gateways.foxglove.server import FoxgloveServer
from hil.gateways.json_lines.server import JsonGateway
from hil.gateways.prometheus import Endpoint
from hil.gateways.ros1.bridge import Ros1Bridge
from hil.gateways.rosbridge.server import RosbridgeServer
from hil.view.feed import Feed
from hil.view.page_server import PageServer
from tests.support.clients.ros1 import SmallMaster
from tests.support.processes import Program, free_port, wait_for, write_scenario

UPDATE = (
    b"<?xml version='1.0'?><methodCall><methodName>publisherUpdate</methodName><params><param><value>/master</value>"
    b"</param><param><value>/uuv1/cmd_vel</value></param><param><value><array><data><value>http://127.0.0.1:9/</value>"
    b"</data></array></value></param></params></methodCall>"
)
SHUTDOWN = b"<?xml version='1.0'?><methodCall><methodName>shutdown</methodName><params/></methodCall>"
PAGE = "https://page.example"
UPGRADE = {
    "Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Key": "MDEyMzQ1Njc4OTAxMjM0NQ==",
    "Sec-WebSocket-Version": "13",
}  # fmt: skip


class Hostile(NamedTuple):
    method: str
    path: str
    headers: dict[str, str]
    body: bytes = b""

    def encoded(self, port: int) -> bytes:
        headers = {"Host": f"127.0.0.1:{port}", "Content-Length": str(len(self.body)), **self.headers}
        lines = [f"{self.method} {self.path} HTTP/1.1", *[f"{name}: {text}" for name, text in headers.items()]]
        return "\r\n".join(lines).encode() + b"\r\n\r\n" + self.body


def plain(origin: str = PAGE, **headers: str) -> dict[str, str]:
    return {"Origin": origin, "Content-Type": "text/plain", **headers}


REQUESTS = [
    Hostile("GET", "/", {"Origin": PAGE}),
    Hostile("GET", "/", {"Origin": "null"}),
    Hostile("GET", "/", {"Host": "rebound.example"}),
    Hostile("GET", "/", {"Host": "127.0.0.1.rebound.example"}),
    Hostile("GET", "/", {"Host": "rebound.example", "Origin": "http://rebound.example"}),
    Hostile("GET", "/metrics", {"Host": "rebound.example:80"}),
    Hostile("GET", "/metrics", {"Origin": "http://127.0.0.1:1"}),
    Hostile("GET", "/", {"Origin": PAGE, **UPGRADE}),
    Hostile("GET", "/", {"Host": "rebound.example", "Origin": "http://rebound.example", **UPGRADE}),
    Hostile("GET", "/?token=wrong", {"Origin": PAGE, **UPGRADE}),
    Hostile("GET", "/stick?token=", {"Origin": PAGE, **UPGRADE}),
    Hostile("GET", "/scene", {"Host": "localhost.rebound.example"}),
    Hostile("POST", "/", plain(), UPDATE),
    Hostile("POST", "/RPC2", plain(Host="rebound.example"), UPDATE),
    Hostile("POST", "/", plain(), SHUTDOWN),
    Hostile("POST", "/", {"Origin": PAGE, "Content-Type": "text/xml"}, UPDATE),
    Hostile("POST", "/", {"Host": "rebound.example", "Content-Type": "text/xml"}, SHUTDOWN),
    Hostile("POST", "/", {"Content-Type": "application/x-www-form-urlencoded"}, UPDATE),
    Hostile("POST", "/", plain(), b'{"id": 1, "do": "drive", "surge": 1.0}\n'),
    Hostile("OPTIONS", "/", {"Origin": PAGE, "Access-Control-Request-Method": "POST"}),
]


class Server(NamedTuple):
    """A server at `port`; `greeting` is a request that it serves, answered by `answer`."""

    port: int
    greeting: bytes
    answer: bytes = b"HTTP/1.1 200"


def get(path: str, port: int, version: str = "1.1", headers: str = "") -> bytes:
    return f"GET {path} HTTP/{version}\r\nHost: 127.0.0.1:{port}\r\n{headers}\r\n".encode()


def websocket(port: int) -> Server:
    headers = "".join(f"{name}: {text}\r\n" for name, text in UPGRADE.items())
    return Server(port, get("/", port, headers=headers), b"HTTP/1.1 101")


@contextmanager
def opened(kind: str) -> Iterator[Server]:
    with ExitStack() as stack:
        fleet = stack.enter_context(hil.connect("tcp/127.0.0.1:1"))
        commanding = Commanding(fleet)
        if kind == "view":
            page = stack.enter_context(PageServer("127.0.0.1", 0, "a-token", b"", Feed(), lambda _, __: {}))
            yield Server(page.port, get("/?token=a-token", page.port), b"HTTP/1.1 302")
        elif kind == "foxglove":
            yield websocket(stack.enter_context(FoxgloveServer("127.0.0.1", 0, commanding)).port)
        elif kind == "rosbridge":
            yield websocket(stack.enter_context(RosbridgeServer("127.0.0.1", 0, commanding)).port)
        elif kind == "ros1":
            master = stack.enter_context(SmallMaster())
            bridge = Ros1Bridge("uuv_hil", ("127.0.0.1", 0), master.uri, commanding, True, lambda _: None)
            stack.enter_context(bridge)
            yield Server(bridge.port, ros1_greeting(bridge.port))
            assert not bridge.ended
        elif kind == "gateway":
            gateway = stack.enter_context(JsonGateway(fleet, "127.0.0.1", 0))
            yield Server(gateway.port, *GATEWAY)
        else:
            endpoint = stack.enter_context(Endpoint(("127.0.0.1", 0), NoSlaves()))
            port = int(endpoint.address.rpartition(":")[2].partition("/")[0])
            yield Server(port, get("/metrics", port), b"HTTP/1.0 200")


class NoSlaves(HealthWatch):
    def __init__(self) -> None: ...

    def statuses(self) -> list[Any]:
        return []


def ros1_greeting(port: int) -> bytes:
    body = (
        b"<methodCall><methodName>getPid</methodName><params><param><value>/test</value></param></params></methodCall>"
    )
    return Hostile("POST", "/", {"Content-Type": "text/xml"}, body).encoded(port)


GATEWAY = b'{"id": 1, "do": "nothing"}\n', b'{"id": 1, "ok": false'
KINDS = ["view", "foxglove", "rosbridge", "ros1", "gateway", "prometheus"]


def answer_to(port: int, request: bytes) -> bytes:
    """Return the first bytes that a server sends after a request; b"" if it closes the connection."""
    with socket.create_connection(("127.0.0.1", port), 30) as connection:
        connection.sendall(request)
        try:
            return connection.recv(4096)
        except ConnectionError:
            return b""


@pytest.mark.parametrize("kind", KINDS)
def test_no_hostile_request_is_served(kind: str) -> None:
    with opened(kind) as server:
        for request in REQUESTS:
            answer = answer_to(server.port, request.encoded(server.port))
            is_refused = answer.startswith((b"HTTP/1.1 4", b"HTTP/1.0 4", b"HTTP/1.0 501", b'{"id": null, "ok": false'))
            assert is_refused or not answer, f"{request}: {answer[:200]!r}"
        assert wait_for(lambda: answer_to(server.port, server.greeting).startswith(server.answer))


@pytest.mark.parametrize("kind", KINDS)
def test_connections_that_send_nothing_do_not_keep_others_out(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (http_server, plain_server):
        monkeypatch.setattr(module, "REQUEST_S", 1.0)
    monkeypatch.setattr("hil.gateways.json_lines.server.REQUEST_S", 1.0)
    threads = threading.active_count()
    with opened(kind) as server, ExitStack() as silent:
        for number in range(MAX_CONNECTIONS + 50):
            connection = silent.enter_context(socket.create_connection(("127.0.0.1", server.port), 30))
            if number % 2:
                connection.sendall(b"GET /")  # half a request line
        assert wait_for(lambda: answer_to(server.port, server.greeting).startswith(server.answer))
    assert wait_for(lambda: threading.active_count() <= threads + 2)


@pytest.mark.parametrize("name", ["rosbridge", "gateway"])
def test_a_gateway_without_descriptors_continues(tmp_path: Path, name: str) -> None:
    """Its search for unread links needs descriptors, too."""
    path, port = write_scenario(tmp_path)
    listen = free_port()
    arguments = (name, "--connect", f"tcp/127.0.0.1:{port}", "--listen", f"127.0.0.1:{listen}")
    with Program(tmp_path, "slave", path) as slave, Program(tmp_path, *arguments) as gateway:
        slave.expect("ready")
        gateway.expect("connected: uuv1")
        process = psutil.Process(gateway.process.pid)
        limit = process.num_fds() + 4
        process.rlimit(psutil.RLIMIT_NOFILE, (limit, limit))
        with ExitStack() as held:
            for _ in range(60):
                held.enter_context(socket.create_connection(("127.0.0.1", listen), 30))
            time.sleep(3.0)  # several checks of its links
            assert process.is_running(), gateway.output
        server = Server(listen, *GATEWAY) if name == "gateway" else websocket(listen)
        assert wait_for(lambda: answer_to(listen, server.greeting).startswith(server.answer)), gateway.output
        assert len(gateway.output) < 4000, gateway.output


@pytest.mark.parametrize(
    ("listen", "host", "served"),
    [
        ("127.0.0.1", "localhost:8765", True), ("127.0.0.1", "[::1]:8765", True), ("127.0.0.1", "127.9.9.9", True),
        ("127.0.0.1", "192.168.2.2:8765", False), ("127.0.0.1", "", False), ("127.0.0.1", "localhost.", True),
        ("127.0.0.1", socket.gethostname(), False), ("0.0.0.0", socket.gethostname(), True),
        ("0.0.0.0", f"{socket.gethostname()}.local:80", True), ("0.0.0.0", "192.168.2.2:8765", True),
        ("0.0.0.0", "rebound.example", False), ("vehicle.lan", "vehicle.lan:8765", True), ("::", "[fe80::1]:1", True),
        ("0.0.0.0", "named.example", True), ("0.0.0.0", "[::1", True), ("0.0.0.0", "[", False),
    ],
)  # fmt: skip
def test_a_host_is_own_by_address_or_name(listen: str, host: str, served: bool) -> None:
    assert (not WebAccess(listen, names=("named.example",)).refusal(host, "")) == served
    assert not WebAccess(listen).refusal(host, "", has_token=True), "the token admits any host"
