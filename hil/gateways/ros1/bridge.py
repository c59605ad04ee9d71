"""Vehicles on a ROS 1 network: what they publish, take and answer is offered by one node, as they appear."""

import asyncio
import os
import re
import socket
from collections.abc import Callable, Iterable
from typing import Any
from urllib.parse import urlsplit

from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import ConfigError, HilError, NetworkError
from hil.common.text import clean
from hil.common.web.server_thread import ServerThread
from hil.gateways.commanding import Commanding
from hil.gateways.ros1.messages import kind_of
from hil.gateways.ros1.node import Node
from hil.gateways.ros1.parameters import ParameterMirror
from hil.recording.mcap_file import Message
from hil.ros import message as ros_message
from hil.ros.graph import Entity
from hil.ros.topics import COMMANDS, TOPICS

LOOK_S = 1.0  # between two checks of which vehicles are there
REPORT_NS = 60 * NS_PER_S  # between two lines about the same
MAX_KEYS = 1000  # of lines that are remembered
MAX_LATCHED = 64  # last messages of a latched topic that all vehicles share
NAME = re.compile(r"/[A-Za-z][A-Za-z0-9_/]*\Z")  # of a topic or a service in ROS 1
ANYWHERE = ("0.0.0.0", "::")
DEFAULT_MASTER = "http://localhost:11311"
DESCRIPTION, EVENTS = "robot_description", "/parameter_events"


def master_uri() -> str:
    """Return the address of the ROS master, as ROS 1 has it: ROS_MASTER_URI. Raises ConfigError."""
    uri = os.environ.get("ROS_MASTER_URI") or DEFAULT_MASTER
    try:
        parts = urlsplit(uri)
        is_right = parts.scheme == "http" and bool(parts.hostname) and bool(parts.port)
    except ValueError:
        is_right = False
    if not is_right:
        raise ConfigError(f"ROS_MASTER_URI: {uri!r} is not http://HOST:PORT, such as {DEFAULT_MASTER}")
    return uri


def own_host(listen: str, master: str) -> str:
    """Return the name by which others reach this node: ROS_HOSTNAME or ROS_IP where it listens everywhere."""
    if listen not in ANYWHERE:
        return listen
    named = os.environ.get("ROS_HOSTNAME") or os.environ.get("ROS_IP")
    if named:
        return named
    parts = urlsplit(master)
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect((parts.hostname, parts.port))  # sends nothing: the kernel chooses the address towards it
            return str(probe.getsockname()[0])
    except OSError:
        return socket.gethostname()


class Ros1Bridge(ServerThread):
    """Serves vehicles to the ROS 1 network of `master`, as the node `name`, in a thread of its own. Use as a context.

    With `may_command` it takes commands, offers services, and sets parameters. `report` gets lines for a person, in
    that thread. `ended` is why another node has asked it to end. Raises NetworkError when a port is taken.
    """

    def __init__(
        self,
        name: str,
        listen: tuple[str, int],
        master: str,
        commanding: Commanding,
        may_command: bool,
        report: Callable[[str], None],
    ) -> None:
        self.ended = ""
        self._commanding = commanding
        self._may_command = may_command
        self._print = report
        self._reported: dict[str, int] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._node = Node(f"/{name}", own_host(listen[0], master), master, self._report)
        super().__init__("ros1", *listen)

    def __enter__(self) -> "Ros1Bridge":
        return self

    @property
    def api(self) -> str:
        """Address of the node's XML-RPC interface."""
        return self._node.api

    def show(self, messages: Iterable[Message]) -> None:
        """Publish messages of ROS 2 to who subscribes to their topics in ROS 1."""
        batch = list(messages)
        if batch:
            self._loop.call_soon_threadsafe(self._show, batch)

    async def _start(self, host: str, port: int) -> int:
        listening = await self._node.start(host, port)
        self._parameters = ParameterMirror(self._commanding, self._node.master, self._may_command, self._print)
        self._node.on_parameter = lambda key, value: self._do(self._parameters.update(key, value))
        self._node.on_shutdown = self._end
        self._node.master.on_connected = self._greet_master
        self._do(self._node.master.watch())
        self._do(self._watch())
        return listening

    async def _stop(self) -> None:
        for task in list(self._tasks):
            task.cancel()
        await self._node.stop()

    def _refusal(self, host: str, port: int, error: OSError) -> NetworkError:
        """Return the error for ports that are taken: the interface has one, TCPROS the next."""
        ports = f"{port} and {port + 1}" if port else "a port"
        return NetworkError(f"cannot listen at {host}, {ports}: {error.strerror}; choose others with --listen")

    def _do(self, work: Any) -> None:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _end(self, reason: str) -> None:
        self.ended = clean(reason) or "another node asked it to"

    def _report(self, key: str, line: str) -> None:
        """Report a line, of those with the same key one a minute."""
        now = now_ns()
        if now - self._reported.get(key, -REPORT_NS) < REPORT_NS and key != "master":
            return
        while len(self._reported) >= MAX_KEYS:
            del self._reported[next(iter(self._reported))]
        self._reported[key] = now
        self._print(clean(line, 400))

    def _show(self, messages: list[Message]) -> None:
        for message in messages:
            if message.topic == EVENTS:
                self._do(self._refresh_parameters())
            elif message.topic in self._node.publications or self._publish(message.topic, message.type):
                self._node.publications[message.topic].publish(message)
                if message.topic.endswith(f"/{DESCRIPTION}"):
                    self._do(self._set_description(message))

    def _publish(self, topic: str, type_name: str) -> bool:
        """Offer a topic; return whether ROS 1 can have it. Commands that are taken from there are not.

        ROS 1 has its own /rosout, of another type.
        """
        name = topic.rpartition("/")[2]
        if topic == "/rosout" or not NAME.match(topic) or (self._may_command and name in COMMANDS):
            return False
        try:
            kind = kind_of(type_name)
        except ConfigError as error:
            self._report(type_name, f"{topic} is not published: {error}")
            return False
        row = TOPICS.get(topic) or TOPICS.get(name)
        latched = 0 if row is None or not row.qos.latched else MAX_LATCHED if topic in TOPICS else 1
        return self._node.publish(topic, kind, latched, self._on_subscriber) is not None

    def _on_subscriber(self, topic: str) -> None:
        self._do(self._subscribe(topic))

    async def _subscribe(self, topic: str) -> None:
        """Declare on the vehicle's network a subscriber of a topic."""
        try:
            await asyncio.to_thread(self._commanding.subscribe, topic)
        except HilError as error:
            self._report(topic, f"{topic}: {error}")

    async def _watch(self) -> None:
        """Offer what vehicles that are there have; never ends."""
        known: set[str] = set()
        while True:
            try:
                entities = await asyncio.to_thread(self._commanding.entities)
                for entity in entities:
                    self._offer(entity)
                nodes = {entity.node for entity in entities if entity.kind == "SS"}
                if nodes - known:
                    await self._refresh_parameters()
                    known |= nodes
            except HilError as error:
                self._report("vehicles", str(error))
            await asyncio.sleep(LOOK_S)

    def _offer(self, entity: Entity) -> None:
        """Offer a topic or a service of the network to ROS 1."""
        name = entity.topic.rpartition("/")[2]
        if entity.kind == "MP" and entity.topic not in self._node.publications:
            if entity.topic != EVENTS and self._publish(entity.topic, entity.type) and name == DESCRIPTION:
                self._on_subscriber(entity.topic)  # it is a parameter in ROS 1
        elif not self._may_command or not NAME.match(entity.topic):
            return
        elif entity.kind == "MS" and name in COMMANDS and entity.topic == f"{entity.node}/{name}":
            self._node.subscribe(entity.topic, kind_of(TOPICS[name].type), self._commanding.publish)
        elif entity.kind == "SS" and entity.topic not in self._node.services:
            try:
                self._node.serve(entity.topic, kind_of(entity.type), self._commanding)
            except ConfigError:
                return  # ROS 1 has other means for it, or no type

    async def _greet_master(self) -> None:
        self._parameters.forget()
        await self._refresh_parameters()

    async def _refresh_parameters(self) -> None:
        if not self._node.master.is_present:
            return
        try:
            await self._parameters.refresh()
        except HilError as error:
            self._report("parameters", f"parameters: {error}")

    async def _set_description(self, message: Message) -> None:
        """Set the parameter that RViz and others read a vehicle's URDF from."""
        values = ros_message.decode(message.type, message.data)
        if values:
            try:
                await self._node.master.set_parameter(message.topic, values["data"])
            except HilError as error:
                self._report(message.topic, f"{message.topic}: {error}")
