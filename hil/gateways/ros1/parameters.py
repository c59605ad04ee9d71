"""Parameters of vehicles on the parameter server of ROS 1: gains.surge.p of uuv1 is /uuv1/gains/surge/p there.

What vehicles have is written there, whenever it changes. Who may command sets them there, too: the master reports it,
and a value that the vehicle refuses is replaced by the one it has.
"""

import asyncio
from collections.abc import Callable, Iterator
from typing import Any

from hil.common.errors import HilError, NetworkError
from hil.gateways.commanding import Commanding
from hil.gateways.ros1.master import Master


class ParameterMirror:
    """The parameters of `commanding`'s vehicles at a master. `report` gets a line for what is refused."""

    def __init__(
        self, commanding: Commanding, master: Master, may_command: bool, report: Callable[[str], None]
    ) -> None:
        self._commanding = commanding
        self._master = master
        self._may_command = may_command
        self._report = report
        self._names: dict[str, str] = {}  # key there -> name here
        self._values: dict[str, Any] = {}  # by key, as the vehicle has them
        self._watched: set[str] = set()
        self._lock = asyncio.Lock()

    def forget(self) -> None:
        """Write everything again to a new master."""
        self._values.clear()
        self._watched.clear()

    async def refresh(self) -> None:
        """Read what vehicles have, and write what has changed. Raises HilError."""
        async with self._lock:
            await self._refresh()

    async def _refresh(self) -> None:
        for name, value in (await asyncio.to_thread(self._commanding.parameters)).items():
            key = key_of(name)
            self._names[key] = name
            if self._values.get(key) != value:
                self._values[key] = value
                await self._master.set_parameter(key, value)
            group = key.rpartition("/")[0]
            if self._may_command and group not in self._watched:
                self._watched.add(group)
                await self._master.watch_parameters(group)

    async def update(self, key: str, value: Any) -> None:
        """Set what somebody has set at the master; parameters that are not ours are left alone."""
        async with self._lock:
            for leaf, each in leaves(key.rstrip("/"), value):
                if leaf not in self._names or self._values.get(leaf) == each:
                    continue
                try:
                    await self._set(leaf, each)
                except NetworkError as error:
                    self._report(f"{leaf}: {error}")

    async def _set(self, key: str, value: Any) -> None:
        try:
            if not self._may_command:
                return
            await asyncio.to_thread(self._commanding.set_parameters, {self._names[key]: value})
            self._values[key] = value
        except HilError as error:
            self._report(f"{key}: {error}")
            await self._master.set_parameter(key, self._values[key])


def key_of(name: str) -> str:
    """Return "/uuv1/gains/surge/p" of "/uuv1/gains.surge.p"."""
    return name.replace(".", "/")


def leaves(key: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the keys and values in a value of the parameter server, which may be a tree."""
    if not isinstance(value, dict):
        yield key, value
        return
    for name, each in value.items():
        yield from leaves(f"{key}/{name}", each)
