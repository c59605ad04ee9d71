"""A server of asyncio in a thread of its own: started with its port open, stopped with all its clients."""

import asyncio
import logging
import threading
from abc import ABC, abstractmethod

from hil.common.errors import NetworkError
from hil.common.stop import cancel_tasks

STOP_WITHIN_S = 10.0


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


def http_log() -> logging.Logger:
    """Return a log of aiohttp's for our own mistakes: bytes that are not HTTP would fill it with tracebacks."""
    logger = logging.getLogger(__name__)
    logger.addFilter(_is_ours)
    return logger


def _is_ours(record: logging.LogRecord) -> bool:
    from aiohttp.http_exceptions import HttpProcessingError

    return not (record.exc_info and isinstance(record.exc_info[1], HttpProcessingError))
