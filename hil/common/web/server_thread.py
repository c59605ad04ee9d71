"""An asyncio server in a separate thread; its port is open after construction; the end of the context closes it."""

import asyncio
import logging
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from socket import SO_LINGER, SOL_SOCKET
from struct import pack
from typing import Any

from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import NetworkError
from hil.common.stop import cancel_tasks
from hil.common.text import clean

STOP_WITHIN_S = 10.0
STALLED_S = 10.0  # a client that does not read for this time is disconnected
REPEAT_NS = 60 * NS_PER_S  # between two log lines about the same fault
ABNORMAL_CLOSURE = 1006  # close code of a websocket whose peer answered no heartbeat (RFC 6455, 7.4.1)


class ServerThread(ABC):
    """Serve at `host`:`port` (0: any free port; see `port`) in a thread called `name`. Use as a context manager.

    Raises NetworkError if the port is in use.
    """

    def __init__(self, name: str, host: str, port: int) -> None:
        self._loop = asyncio.new_event_loop()
        self._loop.set_exception_handler(_LoopFaults())
        try:
            self.port: int = self._loop.run_until_complete(self._start(host, port))
        except OSError as error:
            self._loop.run_until_complete(self._stop_all())
            self._loop.close()
            raise self._refusal(host, port, error) from None
        self._thread = threading.Thread(target=self._loop.run_forever, name=name, daemon=True)
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        asyncio.run_coroutine_threadsafe(self._stop_all(), self._loop).result(STOP_WITHIN_S)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.run_until_complete(self._loop.shutdown_default_executor())
        self._loop.close()

    @abstractmethod
    async def _start(self, host: str, port: int) -> int:
        """Listen and return the port. Raises OSError if the port is in use."""

    @abstractmethod
    async def _stop(self) -> None:
        """Close what `_start` has opened, also after `_start` failed half-way."""

    def _refusal(self, host: str, port: int, error: OSError) -> NetworkError:
        """Return the error for a port that is in use."""
        return NetworkError(f"cannot listen on {host}:{port}: {error.strerror}; choose another place with --listen")

    async def _stop_all(self) -> None:
        await self._stop()
        await cancel_tasks()


class _LoopFaults:
    """Log what fails in the loop itself as one line, once a minute a kind: without descriptors it fails many times."""

    def __init__(self) -> None:
        self._logged_ns: dict[tuple[type, int | None], int] = {}

    def __call__(self, _: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        kind = type(error), getattr(error, "errno", None)
        now = now_ns()
        if now - self._logged_ns.get(kind, -REPEAT_NS) >= REPEAT_NS:
            self._logged_ns[kind] = now
            logging.getLogger(__name__).error("%s: %s", clean(str(context["message"]), 200), error)


async def first_done(*work: Any) -> None:
    """Wait until one of the awaitables is done, and cancel the others. Raises what the first one raises."""
    tasks = [asyncio.ensure_future(each) for each in work]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


@contextmanager
def cut_when_stalled(websocket: Any, transport: asyncio.Transport) -> Iterator[None]:
    """Abort the connection of aiohttp's `websocket` if the body ends with TimeoutError or ConnectionError.

    Also if the peer answered no heartbeat. A normal close would wait for a client that does not read.
    """
    is_stalled = False
    try:
        yield
    except (asyncio.TimeoutError, ConnectionError):
        is_stalled = True
    if is_stalled or websocket.close_code == ABNORMAL_CLOSURE:
        linger = pack("hh" if sys.platform == "win32" else "ii", 1, 0)  # on, 0 s: reset at close
        with suppress(OSError):  # already closed
            transport.get_extra_info("socket").setsockopt(SOL_SOCKET, SO_LINGER, linger)
        transport.abort()
