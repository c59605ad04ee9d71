"""A topic of commands that the gateway takes from publishers of ROS 1.

Each publisher is asked where it sends the topic, and connected to, again after each loss. As with ROS 2, one commands:
while its messages come, those of others on the topic are dropped. Of what comes faster than the vehicle takes it, the
newest is sent: no command waits for others.
"""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

import aiohttp

from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import HilError, NetworkError
from hil.gateways.commanding import LARGEST
from hil.gateways.ros1 import tcpros
from hil.gateways.ros1.messages import Kind, UnreadableError, to_cdr
from hil.gateways.ros1.xmlrpc import call

HELD_NS = NS_PER_S  # after the last message of the commanding publisher, until another one may command
FIRST_RETRY_S, LAST_RETRY_S = 0.2, 5.0
CONNECT_S = 5.0
MAX_PUBLISHERS = 32

Report = Callable[[str, str], None]  # a key, of which one line is reported now and then, and the line
Send = Callable[[str, bytes], None]


class Caller(NamedTuple):
    """This node: its name, and the session that calls others."""

    name: str
    session: aiohttp.ClientSession


class Subscription:
    """One topic. `send` gets each command, CDR, in another thread; it may raise HilError."""

    def __init__(self, topic: str, kind: Kind, caller: Caller, send: Send, report: Report) -> None:
        self.topic = topic
        self.kind = kind
        self.received = self.malformed = self.refused = self.superseded = 0
        self._caller = caller
        self._send = send
        self._report = report
        self._publishers: dict[str, asyncio.Task[None]] = {}
        self._holder, self._held_until_ns = "", 0
        self._newest: bytes | None = None
        self._wake = asyncio.Event()
        self._worker = asyncio.get_running_loop().create_task(self._forward())

    @property
    def publishers(self) -> list[str]:
        """Addresses of the nodes that publish it."""
        return list(self._publishers)

    def set_publishers(self, uris: list[str]) -> None:
        """Connect to the nodes at these addresses, and leave others."""
        wanted = set(uris[:MAX_PUBLISHERS])
        for uri in self._publishers.keys() - wanted:
            self._publishers.pop(uri).cancel()
        for uri in wanted - self._publishers.keys():
            self._publishers[uri] = asyncio.get_running_loop().create_task(self._follow(uri))

    async def close(self) -> None:
        """Leave all publishers."""
        tasks = [self._worker, *self._publishers.values()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _follow(self, uri: str) -> None:
        """Read from one publisher for as long as it is in the list."""
        retry_s = FIRST_RETRY_S
        while True:
            before = self.received
            try:
                await self._read(uri)
            except (tcpros.PeerError, NetworkError) as error:
                self._report(f"{self.topic} {uri}", f"{self.topic} from {uri}: {error}")
            except (OSError, asyncio.IncompleteReadError, asyncio.TimeoutError):
                pass  # the publisher has ended: the master reports it soon
            retry_s = FIRST_RETRY_S if self.received > before else min(LAST_RETRY_S, 2.0 * retry_s)
            await asyncio.sleep(retry_s)

    async def _read(self, uri: str) -> None:
        protocols = [["TCPROS"]]
        answer = await call(self._caller.session, uri, "requestTopic", self._caller.name, self.topic, protocols)
        match answer:
            case ["TCPROS", str() as host, int() as port, *_]:
                pass
            case _:
                raise tcpros.PeerError("it offers no TCPROS")
        reader, writer = await asyncio.wait_for(asyncio.open_connection(host, port), CONNECT_S)
        try:
            tcpros.set_options(writer)
            header = {
                "callerid": self._caller.name,
                "md5sum": self.kind.md5sum,
                "message_definition": self.kind.definition,
                "tcp_nodelay": "1",
                "topic": self.topic,
                "type": self.kind.name,
            }
            writer.write(tcpros.encode_header(header))
            reply = await tcpros.read_header(reader)
            if "error" in reply:
                raise tcpros.PeerError(reply["error"][:200])
            tcpros.require_type(reply, self.topic, self.kind.name, self.kind.md5sum)
            sender = reply.get("callerid", uri)[:256]
            while True:
                self._accept_command(sender, await tcpros.read_frame(reader, LARGEST, "a command"))
        finally:
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()

    def _accept_command(self, sender: str, data: bytes) -> None:
        now = now_ns()
        if sender != self._holder and now < self._held_until_ns:
            self.refused += 1
            self._report(
                f"{self.topic} {sender}", f"{self.topic}: {self._holder} commands; what {sender} sends is dropped"
            )
            return
        try:
            payload = to_cdr(self.kind.type, data)
        except UnreadableError:
            self.malformed += 1
            return
        self._holder, self._held_until_ns = sender, now + HELD_NS
        self.received += 1
        self.superseded += self._newest is not None
        self._newest = payload
        self._wake.set()

    async def _forward(self) -> None:
        while True:
            await self._wake.wait()
            self._wake.clear()
            payload, self._newest = self._newest, None
            if payload is None:
                continue
            try:
                await asyncio.to_thread(self._send, self.topic, payload)
            except HilError as error:
                self._report(self.topic, f"{self.topic}: {error}")
