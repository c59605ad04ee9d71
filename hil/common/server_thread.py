"""A server of asyncio in a thread of its own: started with its port open, stopped with all its clients."""

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

from hil.common.errors import NetworkError
from hil.common.stop import cancel_tasks

STOP_WITHIN_S = 10.0
STALLED_S = 10.0  # after which a client that takes nothing of what it is sent is closed
ABNORMAL_CLOSURE = 1006  # how a websocket is closed whose other end answered no heartbeat (RFC 6455, 7.4.1)


class ServerThread(ABC):
    """Serves at `host`:`port` (0: any free one; see `port`) in a thread of that name. Use as a context.

    Raises NetworkError when the port is taken.
    """

    def __init__(self, name: str, host: str, port: int) -> None:
        self._loop = asyncio.new_event_loop()
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
        """Listen, and return the port. Raises OSError when it is taken."""

    @abstractmethod
    async def _stop(self) -> None:
        """Close what `_start` has opened, also where it has failed half-way."""

    def _refusal(self, host: str, port: int, error: OSError) -> NetworkError:
        """Return the error for a port that is taken."""
        return NetworkError(f"cannot listen on {host}:{port}: {error.strerror}; choose another place with --listen")

    async def _stop_all(self) -> None:
        await self._stop()
        await cancel_tasks()


@contextmanager
def cut_when_stalled(websocket: Any, transport: asyncio.Transport) -> Iterator[None]:
    """Cut the connection of aiohttp's `websocket` if what is done with it ends by TimeoutError or ConnectionError.

    Or if the other end answers no heartbeat. Closed in order, the kernel would wait for a client that does not read.
    """
    is_stalled = False
    try:
        yield
    except (asyncio.TimeoutError, ConnectionError):
        is_stalled = True
    if is_stalled or websocket.close_code == ABNORMAL_CLOSURE:
        linger = pack("hh" if sys.platform == "win32" else "ii", 1, 0)  # for 0 s
        with suppress(OSError):  # it has closed meanwhile
            transport.get_extra_info("socket").setsockopt(SOL_SOCKET, SO_LINGER, linger)
        transport.abort()


def http_log() -> logging.Logger:
    """Return a log of aiohttp's for our own mistakes: bytes that are not HTTP would fill it with tracebacks."""
    logger = logging.getLogger(__name__)
    logger.addFilter(_is_ours)
    return logger


def _is_ours(record: logging.LogRecord) -> bool:
    from aiohttp.http_exceptions import HttpProcessingError

    return not (record.exc_info and isinstance(record.exc_info[1], HttpProcessingError))
