"""One client of the rosbridge server: what it has subscribed to and advertised, and what waits to be sent to it.

https://github.com/RobotWebTools/rosbridge_suite/blob/ros2/ROSBRIDGE_PROTOCOL.md
"""

import asyncio
import json
from collections.abc import Callable, Mapping
from typing import Any

from aiohttp import web

from hil.common.clock import NS_PER_MS, NS_PER_S, now_ns
from hil.common.errors import ConfigError, HilError
from hil.common.text import json_text
from hil.gateways.commanding import Commanding
from hil.gateways.rosbridge import rosapi
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

COMPRESSIONS = ("none", "cbor", "cbor-raw")
LONGEST_THROTTLE_MS = 3_600_000

Latched = Callable[[str], Message | None]


class Subscription:
    """A client's subscriptions to one topic, by their ids: a message is sent once, for the one that wants most.

    What comes within the throttle's time after a message is left out.
    """

    def __init__(self) -> None:
        self._wanted: dict[str, tuple[int, str]] = {}  # least time between messages (ns), and encoding
        self._next_ns = 0  # when the next may be sent

    def add(self, ident: str, request: Mapping[str, Any]) -> None:
        """Add a `subscribe`, or change it. Raises ConfigError."""
        throttle, compression = request.get("throttle_rate") or 0, request.get("compression") or "none"
        if isinstance(throttle, bool) or not isinstance(throttle, (int, float)) or not throttle >= 0:
            raise ConfigError("throttle_rate: expected a number from 0 on")
        if compression not in COMPRESSIONS:
            raise ConfigError(f"compression: {str(compression)[:20]!r} is none of {', '.join(COMPRESSIONS)}")
        self._wanted[ident] = round(min(throttle, LONGEST_THROTTLE_MS) * NS_PER_MS), compression

    def remove(self, ident: str | None) -> bool:
        """Remove one, or all; return whether none is left."""
        if ident is None:
            self._wanted.clear()
        self._wanted.pop(ident or "", None)
        return not self._wanted

    @property
    def compression(self) -> str:
        """The encoding that was asked for last."""
        return next(reversed(self._wanted.values()))[1]

    def admits(self, now: int) -> bool:
        """Return whether a message of now (ns) is to be sent."""
        if now < self._next_ns:
            return False
        self._next_ns = now + min(throttle for throttle, _ in self._wanted.values())
        return True


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

    def show(self, message: Message) -> None:
        """Send a message, if the client wants it."""
        subscription = self._subscriptions.get(message.topic)
        if subscription and subscription.admits(now_ns()):
            self._send_message(subscription, message)

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
        topic = _name(message, "topic")
        Subscription().add("", message)  # an error now
        type_name = whole_type(_name(message, "type")) if message.get("type") else ""
        if len(self._subscriptions) >= MAX_TOPICS:
            raise ConfigError(f"no more than {MAX_TOPICS} topics")
        kind = await asyncio.to_thread(self._api.type_of, topic)
        if type_name and kind and type_name != kind:
            raise ConfigError(f"{topic} has the type {kind}, not {type_name}")
        subscription = self._subscriptions.setdefault(topic, Subscription())
        subscription.add("" if ident is None else str(ident)[:LONGEST_NAME], message)
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
