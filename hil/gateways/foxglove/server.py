"""The websocket server for Foxglove: channels out, and what clients with the token publish, call and set, in.

Its own code and not Foxglove's SDK (0.30), because that can refuse neither pages of other origins nor clients without a
token: a listener sees of a client its number only, and everyone who reaches the port could command a vehicle.
"""

from collections.abc import Callable

from aiohttp import web

from hil.client.parameters import changed_parameters
from hil.common.clock import NS_PER_S, now_ns
from hil.gateways.commanding import Commanding
from hil.gateways.foxglove.client import Client
from hil.gateways.foxglove.protocol import SUBPROTOCOLS, Channel
from hil.gateways.websocket_server import WebSocketServer
from hil.recording.mcap_file import Message, schema_of
from hil.ros.graph import Entity
from hil.ros.topics import TOPICS

EVENTS = "/parameter_events"


class FoxgloveServer(WebSocketServer[Client]):
    """Serves messages of vehicles to Foxglove; clients with the token command them through `commanding`."""

    def __init__(
        self,
        host: str,
        port: int,
        commanding: Commanding | None = None,
        entities: Callable[[], list[Entity]] = list,
    ) -> None:
        self._commanding, self._entities = commanding, entities
        self._time_ns = self._sent_ns = 0  # newest time of a message, and when it was sent to the clients (monotonic)
        self._channels: list[Channel] = []
        self._numbers: dict[str, int] = {}
        self._latched: dict[int, tuple[int, bytes]] = {}  # by channel the last message, for those who come later
        super().__init__(host, port, "foxglove", SUBPROTOCOLS)

    def publish(self, channel: Channel, time_ns: int, data: bytes, latched: bool = False) -> None:
        """Publish a message of the gateway itself on a channel."""
        self._loop.call_soon_threadsafe(self._publish, channel, time_ns, data, latched)

    def _show(self, messages: list[Message]) -> None:
        for message in messages:
            number = self._numbers.get(message.topic)
            if number is None:
                encoding, text = schema_of(message.type)
                channel = Channel(message.topic, message.type, schema=text.decode(), schema_encoding=encoding)
                number = self._number_of(channel)
            row = TOPICS.get(message.topic) or TOPICS.get(message.topic.rpartition("/")[2])
            self._send(number, message.published_ns, message.data, bool(row and row.qos.latched))
            if message.topic == EVENTS and (values := changed_parameters(message.data)):
                for client in self._clients:
                    client.send_parameters(values)
        self._send_time(max([message.published_ns for message in messages], default=0))

    def _send_time(self, time_ns: int) -> None:
        """Send the time of the newest message; it goes back only after a pause, such as a vehicle's new start."""
        if time_ns <= self._time_ns and now_ns() - self._sent_ns < NS_PER_S:
            return
        self._time_ns, self._sent_ns = time_ns, now_ns()
        for client in self._clients:
            client.send_time(time_ns)

    def _publish(self, channel: Channel, time_ns: int, data: bytes, latched: bool) -> None:
        self._send(self._number_of(channel), time_ns, data, latched)

    def _send(self, number: int, time_ns: int, data: bytes, latched: bool) -> None:
        if latched:
            self._latched[number] = time_ns, data
        for client in self._clients:
            client.send_message(number, time_ns, data)

    def _number_of(self, channel: Channel) -> int:
        number = self._numbers.get(channel.topic)
        if number is None:
            number = self._numbers[channel.topic] = len(self._channels)
            self._channels.append(channel)
            for client in self._clients:
                client.advertise({number: channel})
        return number

    def _make_client(self, socket: web.WebSocketResponse, may_command: bool) -> Client:
        """Return the client, to which all channels so far are named."""
        client = Client(socket, self._commanding if may_command else None, self._latched.get, self._entities)
        client.advertise(dict(enumerate(self._channels)))
        return client
