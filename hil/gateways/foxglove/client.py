"""One client of the Foxglove server: its subscriptions, what it may do, and what waits to be sent to it."""

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

from aiohttp import web

from hil.common.errors import HilError
from hil.gateways.commanding import Commanding
from hil.gateways.foxglove import protocol
from hil.gateways.foxglove.assets import read_asset
from hil.gateways.websocket_client import SocketClient
from hil.ros.graph import Entity

MAX_SUBSCRIPTIONS = 1000
LOOK_S = 2.0  # between two looks for new services, and at the graph
NEEDING_TOKEN = (
    "advertise", "unadvertise", "getParameters", "setParameters", "subscribeParameterUpdates",
    "unsubscribeParameterUpdates",
)  # fmt: skip
NO_TOKEN = "to command, open the address with the token that `uuv-hil gateway foxglove --command` printed"

Latched = Callable[[int], tuple[int, bytes] | None]
COMMANDS = ("clientPublish", "services", "parameters", "parametersSubscribe")  # capabilities for clients with the token


class Client(SocketClient):
    """Talks with one client over `socket`, in the thread of the server's loop.

    `commanding` is None for a client that may not command; `latched` gives the last message of a latched channel,
    `entities` the nodes that are there and their endpoints.
    """

    def __init__(
        self,
        socket: web.WebSocketResponse,
        commanding: Commanding | None,
        latched: Latched,
        entities: Callable[[], list[Entity]],
    ) -> None:
        super().__init__(socket)
        self._commanding = commanding
        self._latched = latched
        self._subscriptions: dict[int, int] = {}  # channel -> subscription
        self._topics: dict[int, tuple[str, str]] = {}  # channel of the client -> topic and encoding
        self._services: list[tuple[str, str]] = []
        self._entities = entities
        self._watching_graph: asyncio.Task[None] | None = None
        self._watched: set[str] = set()  # parameters
        capabilities = ["time", "connectionGraph", "assets", *(COMMANDS if commanding else ())]
        encodings = [protocol.CDR, protocol.JSON]
        self._put(
            protocol.encode_text(
                "serverInfo", name="uuv-hil", capabilities=capabilities, supportedEncodings=encodings, metadata={}
            )
        )

    def advertise(self, channels: Mapping[int, protocol.Channel]) -> None:
        """Advertise channels to the client."""
        if channels:
            self._put(
                protocol.encode_text(
                    "advertise", channels=[protocol.encode_channel(*each) for each in channels.items()]
                )
            )

    def send_message(self, channel: int, time_ns: int, data: bytes) -> None:
        """Send a message of a channel, if the client wants it."""
        subscription = self._subscriptions.get(channel)
        if subscription is not None:
            self._put(protocol.encode_message(subscription, time_ns, data))

    def send_time(self, time_ns: int) -> None:
        """Send the time of the newest message."""
        self._put(protocol.encode_time(time_ns))

    def send_parameters(self, values: Mapping[str, Any]) -> None:
        """Send changed parameters, of those that the client has subscribed to."""
        if wanted := {name: value for name, value in values.items() if name in self._watched}:
            self._put(protocol.encode_parameters(wanted))

    async def serve(self) -> None:
        """Send and receive until the client goes."""
        if self._commanding:
            self._start(self._advertise_services())
        await super().serve()

    def _put(self, message: str | bytes) -> None:
        self._queue.put(message, keep=isinstance(message, str))

    def _report(self, text: str, level: int = protocol.ERROR) -> None:
        self._put(protocol.encode_text("status", level=level, message=text))

    async def _write(self) -> None:
        """Send the waiting messages, and report dropped ones."""
        reported = 0
        while True:
            await self._queue.send_waiting()
            if self._queue.dropped != reported:
                reported = self._queue.dropped
                self._report(
                    f"{reported} messages dropped so far: this connection is too slow for them", protocol.WARNING
                )

    async def _on_text(self, text: str) -> None:
        message = protocol.decode_text(text)
        if message is None:
            self._report("not a message of Foxglove's websocket protocol")
            return
        try:
            await self._do(message)
        except (KeyError, TypeError, ValueError, AttributeError):
            self._report(f"{message['op']}: its fields are not those of Foxglove's websocket protocol")
        except HilError as error:
            self._report(str(error))

    async def _do(self, message: Mapping[str, Any]) -> None:
        match message["op"]:
            case "subscribe":
                for each in message["subscriptions"]:
                    self._subscribe(int(each["id"]), int(each["channelId"]))
            case "unsubscribe":
                ended = set(message["subscriptionIds"])
                self._subscriptions = {key: value for key, value in self._subscriptions.items() if value not in ended}
            case "subscribeConnectionGraph":
                self._watching_graph = self._watching_graph or self._start(self._watch_graph())
            case "unsubscribeConnectionGraph" if self._watching_graph:
                self._watching_graph.cancel()
                self._watching_graph = None
            case "fetchAsset":
                await self._send_asset(str(message["uri"]), int(message["requestId"]) & 0xFFFFFFFF)
            case op if op in NEEDING_TOKEN:
                if self._commanding:
                    await self._do_with_token(self._commanding, message)
                else:
                    self._report(NO_TOKEN)

    async def _do_with_token(self, commanding: Commanding, message: Mapping[str, Any]) -> None:
        match message["op"]:
            case "advertise":
                for each in message["channels"][:MAX_SUBSCRIPTIONS]:
                    self._topics[int(each["id"])] = str(each["topic"]), str(each["encoding"])
            case "unadvertise":
                for number in message["channelIds"]:
                    self._topics.pop(int(number), None)
            case "getParameters":
                self._start(self._send_parameters([str(name) for name in message["parameterNames"]], message.get("id")))
            case "setParameters":
                values = {str(each["name"]): each.get("value") for each in message["parameters"]}
                self._start(self._set_parameters(values, message.get("id")))
            case "subscribeParameterUpdates":
                names = [str(name) for name in message["parameterNames"]][:MAX_SUBSCRIPTIONS]
                names = names or list(await asyncio.to_thread(commanding.parameters))
                self._watched.update(names)
            case "unsubscribeParameterUpdates":
                self._watched -= {*map(str, message["parameterNames"])} or self._watched

    def _subscribe(self, subscription: int, channel: int) -> None:
        if len(self._subscriptions) >= MAX_SUBSCRIPTIONS or not 0 <= subscription < 1 << 32:
            self._report(f"no more than {MAX_SUBSCRIPTIONS} subscriptions, numbered with 32 bits")
            return
        self._subscriptions[channel] = subscription
        last = self._latched(channel)
        if last:
            self.send_message(channel, *last)

    async def _on_binary(self, data: bytes) -> None:
        message = protocol.decode_binary(data)
        if message is None:
            self._report("not a binary message of Foxglove's websocket protocol")
        elif self._commanding is None:
            self._report(NO_TOKEN)
        elif isinstance(message, protocol.ClientMessage):
            await self._publish(self._commanding, message)
        else:
            self._start(self._call(self._commanding, message))

    async def _publish(self, commanding: Commanding, message: protocol.ClientMessage) -> None:
        topic, encoding = self._topics.get(message.channel, ("", ""))
        if encoding not in (protocol.CDR, protocol.JSON):
            self._report(f"channel {message.channel} is not advertised with the encoding cdr or json")
            return
        try:
            await asyncio.to_thread(commanding.publish, topic, message.data, encoding)
        except HilError as error:
            self._report(str(error))

    async def _advertise_services(self) -> None:
        """Advertise the services of vehicles as they appear."""
        while self._commanding:
            services = await asyncio.to_thread(self._commanding.services)
            new = [service for service in sorted(services.items()) if service not in self._services]
            if new:
                first = len(self._services)
                self._services += new
                described = [self._commanding.describe(*service) for service in new]
                numbered = [{"id": first + place, **each} for place, each in enumerate(described)]
                self._put(protocol.encode_text("advertiseServices", services=numbered))
            await asyncio.sleep(LOOK_S)

    async def _watch_graph(self) -> None:
        """Send the graph, and then its changes."""
        before = protocol.graph_of(())
        while True:
            now = protocol.graph_of(await asyncio.to_thread(self._entities))
            if text := protocol.encode_graph(before, now):
                self._put(text)
            before = now
            await asyncio.sleep(LOOK_S)

    async def _send_asset(self, uri: str, request: int) -> None:
        """Send a file; the client's next message is read later, so that many requests do not fill the memory."""
        try:
            answer = protocol.encode_asset(request, await asyncio.to_thread(read_asset, uri))
        except HilError as error:
            answer = protocol.encode_asset(request, b"", str(error))
        self._queue.put(answer, keep=True)

    async def _call(self, commanding: Commanding, request: protocol.ServiceRequest) -> None:
        try:
            if request.service >= len(self._services) or request.encoding not in (protocol.CDR, protocol.JSON):
                raise ValueError(f"no service {request.service} with the encoding {request.encoding!r}")
            name, kind = self._services[request.service]
            answer = await asyncio.to_thread(commanding.call, name, kind, request.data, request.encoding)
        except (HilError, ValueError) as error:
            failure = {"serviceId": request.service, "callId": request.call, "message": str(error)}
            self._put(protocol.encode_text("serviceCallFailure", **failure))
        else:
            self._put(protocol.encode_response(request, answer))

    async def _send_parameters(self, names: list[str], request_id: Any) -> None:
        assert self._commanding
        try:
            values = await asyncio.to_thread(self._commanding.parameters, names)
        except HilError as error:
            self._report(str(error))
            return
        self._put(protocol.encode_parameters(values, request_id))

    async def _set_parameters(self, values: Mapping[str, Any], request_id: Any) -> None:
        assert self._commanding
        try:
            await asyncio.to_thread(self._commanding.set_parameters, values)
        except HilError as error:
            self._report(str(error))
        await self._send_parameters(list(values), request_id)
