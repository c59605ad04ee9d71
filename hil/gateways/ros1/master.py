"""The ROS master: what the gateway registers there, again whenever the master was started again."""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any, Literal, NamedTuple

from hil.common.errors import NetworkError
from hil.gateways.ros1.subscription import Caller
from hil.gateways.ros1.xmlrpc import call

CHECK_S = 1.0  # between two checks of whether the master is there
UNREGISTER_S = 2.0  # for all that is unregistered at the end


class Item(NamedTuple):
    """A topic or a service, and its type in ROS 1."""

    kind: Literal["Publisher", "Subscriber", "Service"]
    name: str
    type: str


class Master:
    """The master at `uri`, for the node of `caller` whose own API is at `api`, and whose services are at `services`.

    `on_publishers` gets the publishers of a topic that was registered, `on_connected` is awaited whenever the master is
    there again, `report` gets lines for a person.
    """

    def __init__(self, uri: str, caller: Caller, api: str, services: str, report: Callable[[str], None]) -> None:
        self.uri = uri
        self.is_present: bool | None = None
        self.on_publishers: Callable[[str, list[str]], None] = lambda _topic, _uris: None
        self.on_connected: Callable[[], Awaitable[None]] | None = None
        self._caller = caller
        self._api = api
        self._services = services
        self._report = report
        self._wanted: list[Item] = []
        self._registered: set[Item] = set()
        self._pid: Any = None
        self._changed = asyncio.Event()

    def add(self, item: Item) -> None:
        """Register a topic or a service, as soon as the master is there."""
        if item not in self._wanted:
            self._wanted.append(item)
            self._changed.set()

    def ask_publishers(self, topic: str) -> None:
        """Ask the master for the publishers of a topic that is registered: registering again returns them."""
        items = {item for item in self._registered if item.kind == "Subscriber" and item.name == topic}
        self._registered -= items
        if items:
            self._changed.set()

    async def call(self, method: str, *arguments: Any) -> Any:
        """Call a method of the master in the name of this node. Raises NetworkError."""
        return await call(self._caller.session, self.uri, method, self._caller.name, *arguments)

    async def set_parameter(self, key: str, value: Any) -> None:
        """Set a parameter on the master's parameter server. Raises NetworkError."""
        await self.call("setParam", key, value)

    async def watch_parameters(self, key: str) -> None:
        """Let `paramUpdate` come for what is set below that key. Raises NetworkError."""
        await self.call("subscribeParam", self._api, key)

    async def watch(self) -> None:
        """Keep everything registered; never ends."""
        while True:
            try:
                await self._check()
            except NetworkError as error:
                if self.is_present is not False:
                    self._report(f"no ROS master: {error}; waiting for one (`roscore` there)")
                self.is_present, self._pid = False, None
            with suppress(asyncio.TimeoutError):
                await asyncio.wait_for(self._changed.wait(), CHECK_S)
            self._changed.clear()

    async def _check(self) -> None:
        pid = await self.call("getPid")
        if pid != self._pid:
            self._registered.clear()
        for item in [item for item in self._wanted if item not in self._registered]:
            await self._register(item)
        if pid != self._pid:
            self._pid, self.is_present = pid, True
            self._report(f"the ROS master at {self.uri} is connected")
            if self.on_connected:
                await self.on_connected()

    async def _register(self, item: Item) -> None:
        if item.kind == "Service":
            await self.call("registerService", item.name, self._services, self._api)
        else:
            found = await self.call(f"register{item.kind}", item.name, item.type, self._api)
            if item.kind == "Subscriber" and isinstance(found, list):
                self.on_publishers(item.name, [uri for uri in found if isinstance(uri, str)])
        self._registered.add(item)

    async def unregister(self) -> None:
        """Withdraw what was registered, as far as the master answers in time."""

        async def withdraw() -> None:
            for item in self._registered:
                await self.call(f"unregister{item.kind}", item.name, self._where(item))

        with suppress(NetworkError, asyncio.TimeoutError):
            await asyncio.wait_for(withdraw(), UNREGISTER_S)
        self._registered.clear()

    def _where(self, item: Item) -> str:
        return self._services if item.kind == "Service" else self._api
