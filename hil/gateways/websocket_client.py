"""One client of a gateway's websocket: its tasks, and the messages that wait to be sent to it."""

import asyncio
from abc import ABC, abstractmethod
from collections import deque
from typing import Any

from aiohttp import WSMsgType, web

from hil.common.web.server_thread import STALLED_S, first_done

MAX_BYTES = 32 << 20  # that wait for a client; beyond it the oldest messages are dropped


class SendQueue:
    """Messages that wait to be sent to one client.

    When they are too many, the oldest is dropped if it may be, else the new one if it may be. `dropped` counts them.
    """

    def __init__(self, socket: web.WebSocketResponse) -> None:
        self._socket = socket
        self._waiting: deque[tuple[str | bytes, bool]] = deque()
        self._bytes = 0
        self._wake = asyncio.Event()
        self._has_room = asyncio.Event()
        self._has_room.set()
        self.dropped = 0

    def put(self, message: str | bytes, keep: bool) -> None:
        """Queue a message to be sent; without `keep` it may be dropped."""
        self._waiting.append((message, keep))
        self._bytes += len(message)
        while self._bytes > MAX_BYTES and not self._waiting[0][1] and len(self._waiting) > 1:
            self._bytes -= len(self._waiting.popleft()[0])
            self.dropped += 1
        if self._bytes > MAX_BYTES and not keep and len(self._waiting) > 1:
            self._bytes -= len(self._waiting.pop()[0])
            self.dropped += 1
        if self._bytes > MAX_BYTES:
            self._has_room.clear()
        self._wake.set()

    async def wait_for_room(self) -> None:
        """Wait while too much waits that may not be dropped."""
        await self._has_room.wait()

    async def send_waiting(self) -> None:
        """Wait for something, and send all there is; a client that does not read holds up nobody but itself.

        Raises TimeoutError (asyncio's) when a message could not be sent in STALLED_S, ConnectionError when the client
        is closed.
        """
        await self._wake.wait()
        self._wake.clear()
        while self._waiting:
            message = self._waiting.popleft()[0]
            self._bytes -= len(message)
            if self._bytes <= MAX_BYTES:
                self._has_room.set()
            send = self._socket.send_str(message) if isinstance(message, str) else self._socket.send_bytes(message)
            await asyncio.wait_for(send, STALLED_S)


class SocketClient(ABC):
    """Talks with one client over `socket`, in the thread of the server's loop.

    One that does not read its answers is not read either.
    """

    def __init__(self, socket: web.WebSocketResponse) -> None:
        self._socket = socket
        self._queue = SendQueue(socket)
        self._tasks: set[asyncio.Task[None]] = set()

    async def serve(self) -> None:
        """Send and receive until the client goes; raises what `SendQueue.send_waiting` raises."""
        try:
            await first_done(self._read(), self._write())
        finally:
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)  # one may fail while it is cancelled

    @abstractmethod
    async def _on_text(self, text: str) -> None:
        """Do what a message of text asks for."""

    @abstractmethod
    async def _on_binary(self, data: bytes) -> None:
        """Do what a message of bytes asks for."""

    async def _read(self) -> None:
        async for message in self._socket:
            if message.type is WSMsgType.TEXT:
                await self._on_text(message.data)
            elif message.type is WSMsgType.BINARY:
                await self._on_binary(message.data)
            elif message.type is WSMsgType.PING:
                await asyncio.wait_for(self._socket.pong(message.data), STALLED_S)
            await self._queue.wait_for_room()

    async def _write(self) -> None:
        while True:
            await self._queue.send_waiting()

    def _start(self, work: Any) -> "asyncio.Task[None]":
        """Run a coroutine until it is done or the client goes."""
        task: asyncio.Task[None] = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task
