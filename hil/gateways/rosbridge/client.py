"""One client of the rosbridge server: what it has subscribed to and advertised, and what waits to be sent to it.

https://github.com/RobotWebTools/rosbridge_suite/blob/ros2/ROSBRIDGE_PROTOCOL.md
"""

import asyncio
import json
from collections.abc import Callable, Mapping
from typing import Any

from aiohttp import web

from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import ConfigError, HilError
from hil.common.text import json_text
from hil.gateways.commanding import Commanding
from hil.gateways.rosbridge import rosapi
from hil.gateways.rosbridge.subscription import Subscription, read_options
from hil.gateways.values import arguments, from_json, to_cbor, to_json, whole_type
from hil.gateways.websocket_client import SocketClient
from hil.recording.mcap_file import Message
from hil.ros import message as ros_message
from hil.ros.topics import COMMANDS, TOPICS

MAX_TOPICS = 1000
MAX_CALLS = 32  # of services at a time
LONGEST_NAME = 256  # characters
NO_TOKEN = "to command, open the address with the token that `uuv-hil gateway rosbridge` printed"
NOT_HERE = (
    "advertise_service", "unadvertise_service", "service_response", "advertise_action", "unadvertise_action",
    "send_action_goal", "cancel_action_goal", "action_feedback", "action_result", "fragment", "png", "auth",
)  # fmt: skip

Latched = Callable[[str], Message | None]


class Client(SocketClient):
    """Talks with one client over `socket`, in the thread of the server's loop.

    `may_command`: it has the token; `latched` gives the last message of a latched topic.
    """

    def __init__(
        self,
        socket: web.WebSocketResponse,
        commanding: Commanding,
        api: rosapi.RosApi,
        may_command: bool,
        latched: Latched,
    ) -> None:
        super().__init__(socket)
        self._commanding = commanding
        self._api = api
        self._may_command = may_command
        self._latched = latched
        self._subscriptions: dict[str, Subscription] = {}
        self._advertised: dict[str, str] = {}
        self._calls = 0
        self._timer: asyncio.TimerHandle | None = None

    def show(self, message: Message) -> None:
        """Send a message, if the client wants it."""
        subscription = self._subscriptions.get(message.topic)
        if subscription is None:
            return
        now = subscription.admit(message, now_ns())
        if now is not None:
            self._send_message(subscription, now)
        elif subscription.due_ns is not None:
            self._set_timer()

    async def serve(self) -> None:
        """Send and receive until the client goes."""
        try:
            await super().serve()
        finally:
            if self._timer:
                self._timer.cancel()

    def _put(self, op: str, ident: Any = None, **values: Any) -> None:
        more = {} if ident is None else {"id": ident}
        self._queue.put(json_text({"op": op, **more, **values}), keep=True)

    def _report(self, text: str, ident: Any = None) -> None:
        self._put("status", ident, level="error", msg=text)

    def _send_message(self, subscription: Subscription, message: Message) -> None:
        """Send a message in the encoding that was asked for; one that cannot be decoded is left out."""
        values = ros_message.decode(message.type, message.data) if subscription.compression != "cbor-raw" else {}
        if values is None:
            return
        if subscription.compression == "none":
            published = {"op": "publish", "topic": message.topic, "msg": to_json(message.type, values)}
            self._queue.put(json_text(published), keep=False)
            return
        import cbor2  # where a client asks for it

        if subscription.compression == "cbor":
            content = to_cbor(message.type, values)
        else:
            seconds, nanoseconds = divmod(message.published_ns, NS_PER_S)
            content = {"secs": seconds, "nsecs": nanoseconds, "bytes": message.data}
        published = {"op": "publish", "topic": message.topic, "msg": content}
        self._queue.put(cbor2.dumps(published), keep=False)

    def _set_timer(self) -> None:
        """Look again when the next message that waits is due."""
        due = [each.due_ns for each in self._subscriptions.values() if each.due_ns is not None]
        if due and self._timer is None:
            wait_s = max(0.0, (min(due) - now_ns()) / NS_PER_S)
            self._timer = asyncio.get_running_loop().call_later(wait_s, self._send_due)

    def _send_due(self) -> None:
        self._timer = None
        for subscription in self._subscriptions.values():
            message = subscription.take_waiting(now_ns())
            if message is not None:
                self._send_message(subscription, message)
        self._set_timer()

    async def _on_binary(self, data: bytes) -> None:
        await self._on_text(data.decode(errors="replace"))  # roslibpy sends its JSON so

    async def _on_text(self, text: str) -> None:
        try:
            message = json.loads(text)
        except (ValueError, RecursionError):
            message = None
        if not isinstance(message, dict) or not isinstance(message.get("op"), str):
            self._report('not a message of rosbridge: {"op": ..., ...} in JSON')
            return
        ident = message.get("id")
        ident = ident if isinstance(ident, (str, int)) else None
        try:
            await self._do(message, ident)
        except HilError as error:
            self._report(f"{message['op'][:LONGEST_NAME]}: {error}", ident)

    async def _do(self, message: dict[str, Any], ident: Any) -> None:
        match message["op"]:
            case "subscribe":
                await self._subscribe(message, ident)
            case "unsubscribe":
                topic = _name(message, "topic")
                subscription = self._subscriptions.get(topic)
                if subscription and subscription.remove(None if ident is None else str(ident)):
                    del self._subscriptions[topic]
            case "advertise":
                self._advertise(_name(message, "topic"), whole_type(_name(message, "type")))
            case "unadvertise":
                self._advertised.pop(_name(message, "topic"), None)
            case "publish":
                await self._publish(_name(message, "topic"), message.get("msg"))
            case "call_service":
                if self._calls >= MAX_CALLS:
                    raise ConfigError(f"{MAX_CALLS} calls are not answered yet; wait for them")
                self._calls += 1
                self._start(self._call(message, ident))
            case "set_level" | "status":  # of what is reported: errors only, anyway
                return
            case op if op in NOT_HERE:
                raise ConfigError("this gateway has it not; it subscribes, publishes commands and calls services")
            case op:
                raise ConfigError(f"no operation of rosbridge: {op[:60]!r}")

    async def _subscribe(self, message: dict[str, Any], ident: Any) -> None:
        topic, options = _name(message, "topic"), read_options(message)
        type_name = whole_type(_name(message, "type")) if message.get("type") else ""
        if len(self._subscriptions) >= MAX_TOPICS:
            raise ConfigError(f"no more than {MAX_TOPICS} topics")
        kind = await asyncio.to_thread(self._api.type_of, topic)
        if type_name and kind and type_name != kind:
            raise ConfigError(f"{topic} has the type {kind}, not {type_name}")
        subscription = self._subscriptions.setdefault(topic, Subscription())
        subscription.add("" if ident is None else str(ident)[:LONGEST_NAME], options)
        await asyncio.to_thread(self._commanding.subscribe, topic)
        last = self._latched(topic)
        if last:
            self._send_message(subscription, last)

    def _advertise(self, topic: str, kind: str) -> None:
        if not self._may_command:
            raise ConfigError(NO_TOKEN)
        expected = _command_type(topic)
        if kind != expected:
            raise ConfigError(f"{topic} has the type {expected}, not {kind}")
        if len(self._advertised) >= MAX_TOPICS:
            raise ConfigError(f"no more than {MAX_TOPICS} topics")
        self._advertised[topic] = kind

    async def _publish(self, topic: str, values: Any) -> None:
        if not self._may_command:
            raise ConfigError(NO_TOKEN)
        kind = self._advertised.get(topic) or _command_type(topic)
        payload = ros_message.encode(kind, from_json(kind, values))
        await asyncio.to_thread(self._commanding.publish, topic, payload)

    async def _call(self, message: Mapping[str, Any], ident: Any) -> None:
        service = message.get("service")
        try:
            values = await asyncio.to_thread(self._answer, _name(message, "service"), message.get("args"))
        except HilError as error:
            self._put("service_response", ident, service=service, values=str(error), result=False)
        else:
            self._put("service_response", ident, service=service, values=values, result=True)
        finally:
            self._calls -= 1

    def _answer(self, service: str, given: Any) -> dict[str, Any]:
        """Return the response of a service; in another thread. Raises HilError."""
        if not self._may_command and (service in rosapi.COMMANDS or not service.startswith(rosapi.PREFIX)):
            raise ConfigError(NO_TOKEN)
        if service.startswith(rosapi.PREFIX):
            return self._api.call(service.removeprefix(rosapi.PREFIX), given)
        kind = self._commanding.services().get(service)
        if kind is None:
            raise ConfigError(f"no server for {service}; /rosapi/services lists the services")
        request = ros_message.encode(f"{kind}_Request", arguments(f"{kind}_Request", given))
        response = ros_message.decode(f"{kind}_Response", self._commanding.call(service, kind, request))
        return to_json(f"{kind}_Response", response or {})


def _name(message: Mapping[str, Any], key: str) -> str:
    """Return a name in a message. Raises ConfigError."""
    value = message.get(key)
    if not isinstance(value, str) or not 0 < len(value) <= LONGEST_NAME:
        raise ConfigError(f"{key}: expected a name of up to {LONGEST_NAME} characters")
    return value if key == "type" or value.startswith("/") else f"/{value}"


def _command_type(topic: str) -> str:
    """Return the type of a command's topic. Raises ConfigError."""
    name = topic.rpartition("/")[2]
    if name not in COMMANDS:
        raise ConfigError(f"{topic}: a vehicle takes commands on /NAME/ with {', '.join(COMMANDS)}")
    return TOPICS[name].type
