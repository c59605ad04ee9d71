"""The websocket server for rosbridge: topics out, and what clients with the token publish and call, in."""

from aiohttp import web

from hil.gateways.commanding import Commanding
from hil.gateways.rosbridge.client import Client
from hil.gateways.rosbridge.rosapi import RosApi
from hil.gateways.websocket_server import WebSocketServer
from hil.recording.mcap_file import Message
from hil.ros.topics import TOPICS

MAX_SEEN = 10_000  # topics whose types are remembered


class RosbridgeServer(WebSocketServer[Client]):
    """Serves vehicles to clients of rosbridge; clients with the token command them through `commanding`."""

    def __init__(self, host: str, port: int, commanding: Commanding) -> None:
        self._commanding = commanding
        self._received_types: dict[str, str] = {}
        self._latched: dict[str, Message] = {}
        self._api = RosApi(commanding, self._received_types)
        super().__init__(host, port, "rosbridge")

    def _show(self, messages: list[Message]) -> None:
        for message in messages:
            if message.topic in self._received_types or len(self._received_types) < MAX_SEEN:
                self._received_types[message.topic] = message.type
            row = TOPICS.get(message.topic) or TOPICS.get(message.topic.rpartition("/")[2])
            if row and row.qos.latched and message.topic in self._received_types:
                self._latched[message.topic] = message
            for client in tuple(self._clients):
                client.show(message)

    def _make_client(self, socket: web.WebSocketResponse, may_command: bool) -> Client:
        """Return the client of a socket that was opened."""
        return Client(socket, self._commanding, self._api, may_command, self._latched.get)
