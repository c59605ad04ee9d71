"""A small ROS master and nodes of ROS 1 for tests: TCPROS and XML-RPC at the level of bytes."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from struct import pack, unpack
from typing import Any
from xmlrpc.client import ServerProxy
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

from tests.support.processes import Program, wait_for, write_scenario

PATIENCE_S = 60.0


class _Handler(SimpleXMLRPCRequestHandler):
    rpc_paths = ()  # any


class XmlServer:
    """An XML-RPC server of `methods` at `uri`, in a thread. Use as a context."""

    def __init__(self, methods: dict[str, Any], port: int = 0) -> None:
        self._server = SimpleXMLRPCServer(("127.0.0.1", port), _Handler, logRequests=False, allow_none=False)
        self.port = self._server.server_address[1]
        self.uri = f"http://127.0.0.1:{self.port}"
        for name, method in methods.items():
            self._server.register_function(method, name)
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True)
        self._thread.start()

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End it. Closing twice is harmless."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class SmallMaster(XmlServer):
    """A master that stores what nodes register, by kind ("Publisher") and name, and their parameters.

    `pid` distinguishes masters.
    """

    def __init__(self, port: int = 0, pid: int = 1) -> None:
        self.items: dict[tuple[str, str], tuple[Any, ...]] = {}
        self.parameters: dict[str, Any] = {}
        self.watched: dict[str, str] = {}  # key -> API of who watches
        self.publishers: dict[str, list[str]] = {}  # by topic: addresses given to each subscriber
        self.nodes: dict[str, str] = {}  # name of a node -> its API
        methods: dict[str, Any] = {"getPid": lambda _: [1, "", pid]}
        for kind in ("Publisher", "Subscriber", "Service"):
            methods[f"register{kind}"] = self._registering(kind)
            methods[f"unregister{kind}"] = self._unregistering(kind)
        methods["lookupNode"] = lambda _, name: [1, "", self.nodes[name]] if name in self.nodes else [-1, "unknown", ""]
        methods["getParam"] = lambda _, key: [1, "", self.parameters[key.rstrip("/")]]
        methods["setParam"] = self._set_parameter
        methods["subscribeParam"] = self._watch
        super().__init__(methods, port)

    def announce(self, node: ServerProxy, topic: str, uris: list[str]) -> None:
        """Tell a node that these nodes publish a topic now."""
        self.publishers[topic] = uris
        node.publisherUpdate("/master", topic, uris)

    def names(self, kind: str) -> set[str]:
        return {name for each, name in self.items if each == kind}

    def _registering(self, kind: str) -> Any:
        def register(node: str, name: str, *arguments: str) -> Any:
            self.items[kind, name] = arguments
            self.nodes[node] = arguments[-1]
            return [1, "", self.publishers.get(name, []) if kind == "Subscriber" else []]

        return register

    def _unregistering(self, kind: str) -> Any:
        def unregister(_: str, name: str, __: str) -> Any:
            self.items.pop((kind, name), None)
            return [1, "", 1]

        return unregister

    def _set_parameter(self, _: str, key: str, value: Any) -> Any:
        self.parameters[key] = value
        return [1, "", 0]

    def _watch(self, _: str, api: str, key: str) -> Any:
        self.watched[key] = api
        return [1, "", {}]


class Peer:
    """A TCPROS connection to a node."""

    def __init__(self, port: int, header: dict[str, str] | None = None) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), PATIENCE_S)
        if header is not None:
            self.send(header_bytes(header))

    def __enter__(self) -> "Peer":
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def send(self, data: bytes) -> None:
        self.socket.sendall(data)

    def receive(self) -> bytes:
        """Return the next bytes with their length before them."""
        return self.read(*unpack("<I", self.read(4)))

    def read(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            chunk = self.socket.recv(count - len(data))
            if not chunk:
                raise ConnectionError(f"closed after {len(data)} of {count} bytes")
            data += chunk
        return data

    def header(self) -> dict[str, str]:
        return fields_of(self.receive())


def header_bytes(fields: dict[str, str]) -> bytes:
    items = [f"{key}={value}".encode() for key, value in fields.items()]
    content = b"".join([pack("<I", len(item)) + item for item in items])
    return pack("<I", len(content)) + content


def fields_of(data: bytes) -> dict[str, str]:
    fields = {}
    while data:
        (length,) = unpack("<I", data[:4])
        key, _, value = data[4 : 4 + length].decode().partition("=")
        fields[key] = value
        data = data[4 + length :]
    return fields


class Publisher(XmlServer):
    """A node that publishes one topic to one subscriber at a time; `port` is that of its TCPROS."""

    def __init__(self, name: str, type_name: str, md5sum: str) -> None:
        self._listening = socket.create_server(("127.0.0.1", 0))
        self._listening.settimeout(PATIENCE_S)
        self._reply = {"callerid": name, "type": type_name, "md5sum": md5sum, "latching": "0"}
        self._connection: Peer | None = None
        port = self._listening.getsockname()[1]
        super().__init__({"requestTopic": lambda _caller, _topic, _protocols: [1, "", ["TCPROS", "127.0.0.1", port]]})

    def close(self) -> None:
        super().close()
        self.leave()
        self._listening.close()

    def leave(self) -> None:
        if self._connection:
            self._connection.socket.close()
            self._connection = None

    def accept(self) -> dict[str, str]:
        """Wait for a subscriber; return its header."""
        peer = Peer.__new__(Peer)
        peer.socket, _ = self._listening.accept()
        peer.socket.settimeout(PATIENCE_S)
        header = peer.header()
        peer.send(header_bytes(self._reply))
        self._connection = peer
        return header

    def publish(self, data: bytes) -> None:
        assert self._connection
        self._connection.send(pack("<I", len(data)) + data)


class Served:
    """A vehicle that is served to ROS 1: the master, and the node's interface and TCPROS port."""

    def __init__(self, master: SmallMaster, gateway: Program, slave_port: int) -> None:
        self.master = master
        self.gateway = gateway
        self.slave_port = slave_port
        self.api = gateway.expect(r"at (http://\S+) serves").group(1)
        self.node = ServerProxy(self.api)

    @property
    def tcpros(self) -> int:
        """The TCPROS port; waits until the topic used to request it is registered."""
        assert wait_for(lambda: "/uuv1/imu" in self.master.names("Publisher")), self.gateway.output
        answer: Any = self.node.requestTopic("/test", "/uuv1/imu", [["TCPROS"]])
        return int(answer[2][2])


@contextmanager
def served_to_ros1(folder: Path, *options: str) -> Iterator[Served]:
    """Provide the vehicle uuv1, served by `uuv-hil gateway ros1` with these options."""
    path, port = write_scenario(folder)
    with SmallMaster() as master, Program(folder, "slave", path) as slave:
        slave.expect("ready")
        words = ("gateway", "ros1", "--connect", f"tcp/127.0.0.1:{port}", *options)
        with Program(folder, *words, environment={"ROS_MASTER_URI": master.uri}) as gateway:
            gateway.expect("connected: uuv1")
            served = Served(master, gateway, port)
            with served.node:
                yield served
