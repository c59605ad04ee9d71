"""The node of ROS 1: its XML-RPC interface for other nodes and the master, and its TCPROS server."""

import asyncio
import os
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import aiohttp
from aiohttp import web

from hil.common.errors import NetworkError
from hil.common.web.access import MAX_CONNECTIONS, WebAccess
from hil.common.web.http_server import HttpServer
from hil.common.web.late_address import late_socket
from hil.gateways.commanding import Commanding
from hil.gateways.ros1 import xmlrpc
from hil.gateways.ros1.master import Item, Master
from hil.gateways.ros1.messages import Kind
from hil.gateways.ros1.publication import Publication
from hil.gateways.ros1.services import serve_calls
from hil.gateways.ros1.subscription import Caller, Report, Subscription
from hil.gateways.ros1.tcpros import Connection, PeerError, encode_header, peer_name, read_header, required, set_options

MAX_TOPICS = 2000


class Node:
    """A node called `name`, in the running event loop; `start` opens its ports. Its peers reach it at `host`.

    `on_parameter` gets what was set at the master, `on_shutdown` the reason for which another has asked it to end.
    """

    def __init__(self, name: str, host: str, master_uri: str, report: Report) -> None:
        self.name = name
        self.refused = 0  # connections with no proper header
        self.publications: dict[str, Publication] = {}
        self.subscriptions: dict[str, Subscription] = {}
        self.services: dict[str, Kind] = {}
        self.on_parameter: Callable[[str, Any], None] = lambda _key, _value: None
        self.on_shutdown: Callable[[str], None] = lambda _reason: None
        self._host = host
        self._master_uri = master_uri
        self._report = report
        self._connections = 0
        self._commanding: Commanding | None = None

    async def start(self, listen: str, port: int) -> int:
        """Listen for the interface at `port`, for TCPROS at the next (0: any free ones); return the first.

        Raises OSError.
        """
        self._session = aiohttp.ClientSession(auto_decompress=False)
        app = web.Application(client_max_size=xmlrpc.LARGEST)
        app.router.add_post("/{path:.*}", self._answer)
        self._interface = HttpServer(app, WebAccess(listen, names=(self._host,)))
        self._server: asyncio.Server | None = None
        interface = await self._interface.start(listen, port)
        where = (listen, port + 1 if port else 0)
        late = late_socket(*where)
        self._server = await (
            asyncio.start_server(self._connected, sock=late) if late else asyncio.start_server(self._connected, *where)
        )
        self.api = f"http://{self._host}:{interface}/"
        self._port = int(self._server.sockets[0].getsockname()[1])
        self.caller = Caller(self.name, self._session)
        service_api = f"rosrpc://{self._host}:{self._port}"
        self.master = Master(
            self._master_uri, self.caller, self.api, service_api, lambda line: self._report("master", line)
        )
        self.master.on_publishers = self._set_publishers
        return interface

    async def stop(self) -> None:
        """Unregister, and close all connections."""
        if self._server:
            self._server.close()
            await self.master.unregister()
        for subscription in self.subscriptions.values():
            await subscription.close()
        await self._session.close()
        await self._interface.stop()

    def publish(self, topic: str, kind: Kind, latched: int, on_subscriber: Callable[[str], None]) -> Publication | None:
        """Return the publication of a topic, which is registered if it is new; None for one too many."""
        publication = self.publications.get(topic)
        if publication is None and len(self.publications) < MAX_TOPICS:
            publication = self.publications[topic] = Publication(topic, kind, latched, on_subscriber)
            self.master.add(Item("Publisher", topic, kind.name))
        return publication

    def subscribe(self, topic: str, kind: Kind, send: Callable[[str, bytes], None]) -> None:
        """Take commands on a topic; `send` gets them, CDR."""
        if topic not in self.subscriptions:
            self.subscriptions[topic] = Subscription(topic, kind, self.caller, send, self._report)
            self.master.add(Item("Subscriber", topic, kind.name))

    def serve(self, name: str, service: Kind, commanding: Commanding) -> None:
        """Answer a service of a vehicle."""
        self._commanding = commanding
        if name not in self.services:
            self.services[name] = service
            self.master.add(Item("Service", name, service.name))

    async def _answer(self, request: web.Request) -> web.Response:
        return await xmlrpc.answer(request, self._methods())

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve a connection; one that sends nothing proper gets the reason in a header, and is closed."""
        self._connections += 1
        try:
            if self._connections > MAX_CONNECTIONS:
                raise PeerError(f"{MAX_CONNECTIONS} connections are open already")
            set_options(writer)
            await self._serve(Connection(await read_header(reader), reader, writer))
        except PeerError as error:
            self.refused += 1
            self._report("refused", f"a connection from {peer_name(writer)} was refused: {error}")
            with suppress(OSError):
                writer.write(encode_header({"error": str(error)}))
                await asyncio.wait_for(writer.drain(), xmlrpc.CALL_S)
        except (OSError, asyncio.IncompleteReadError, asyncio.TimeoutError):
            pass  # it has closed
        finally:
            self._connections -= 1
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()

    async def _serve(self, connection: Connection) -> None:
        header = connection.header
        if "service" in header:
            name = header["service"]
            service = self.services.get(name)
            if service is None or self._commanding is None:
                raise PeerError(f"{self.name} has no service {name[:256]!r}")
            await serve_calls(name, service, self._commanding.call, self.name, connection)
            return
        topic, _ = required(header, "topic", "callerid")
        publication = self.publications.get(topic)
        if publication is None:
            raise PeerError(f"{self.name} does not publish {topic[:256]!r}")
        await publication.serve(self.name, connection)

    def _set_publishers(self, topic: str, uris: list[str]) -> None:
        subscription = self.subscriptions.get(topic)
        if subscription:
            subscription.set_publishers([uri for uri in uris if uri != self.api])

    def _methods(self) -> dict[str, xmlrpc.Method]:
        """Return the slave API, http://wiki.ros.org/ROS/Slave_API; `_` is the caller's name."""
        return {
            "getBusInfo": lambda _: self._bus_info(),
            "getMasterUri": lambda _: self._master_uri,
            "getPid": lambda _: os.getpid(),
            "getSubscriptions": lambda _: [[each.topic, each.kind.name] for each in self.subscriptions.values()],
            "getPublications": lambda _: [[each.topic, each.kind.name] for each in self.publications.values()],
            "paramUpdate": self._update_parameter,
            "publisherUpdate": self._update_publishers,
            "requestTopic": self._request_topic,
            "shutdown": self._shutdown,
        }

    def _bus_info(self) -> list[Any]:
        out = [(one.caller, "o", each.topic) for each in self.publications.values() for one in each.subscribers]
        into = [(uri, "i", each.topic) for each in self.subscriptions.values() for uri in each.publishers]
        return [[number, peer, way, "TCPROS", topic, True] for number, (peer, way, topic) in enumerate(out + into)]

    async def _update_parameter(self, _: str, key: str, _value: Any) -> int:
        """Take a parameter as the master has it: everyone who reaches this port can send this."""
        try:
            self.on_parameter(str(key), await self.master.call("getParam", str(key)))
        except NetworkError as error:
            raise xmlrpc.RefusedError(str(error)) from None
        return 0

    def _update_publishers(self, _: str, topic: str, _uris: list[str]) -> int:
        """Ask the master who publishes: everyone who reaches this port can send this."""
        self.master.ask_publishers(str(topic))
        return 0

    def _request_topic(self, _: str, topic: str, protocols: list[Any]) -> list[Any]:
        if topic not in self.publications:
            raise xmlrpc.RefusedError(f"{self.name} does not publish {str(topic)[:256]!r}")
        if not any(isinstance(each, list) and each[:1] == ["TCPROS"] for each in protocols):
            raise xmlrpc.RefusedError("only TCPROS is spoken here")
        return ["TCPROS", self._host, self._port]

    async def _shutdown(self, _: str, reason: str = "") -> int:
        """End if the master has given this node's name to another one, which is when a master sends this."""
        try:
            holder = await self.master.call("lookupNode", self.name)
        except NetworkError as error:
            raise xmlrpc.RefusedError(f"only the master ends this node, and it gives no answer: {error}") from None
        if holder == self.api:
            raise xmlrpc.RefusedError("only the master ends this node, and it lists it; end its process in its place")
        self.on_shutdown(str(reason)[:200])
        return 0
