"""The queue of a websocket client is bounded, also for messages that must not be dropped."""

import asyncio
import gc
from typing import Any, cast

import pytest

from hil.gateways import websocket_client
from hil.gateways.websocket_client import SendQueue, SocketClient


class Socket:
    """A socket that accepts what is sent to it once `read` is set."""

    def __init__(self) -> None:
        self.read = asyncio.Event()
        self.sent: list[str | bytes] = []

    async def send_str(self, text: str) -> None:
        await self.read.wait()
        self.sent.append(text)

    send_bytes = cast(Any, send_str)


@pytest.fixture(autouse=True)
def _small_queue(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(websocket_client, "MAX_BYTES", 10)


def test_a_client_that_does_not_read_replies_is_not_read_from() -> None:
    async def run() -> None:
        socket = Socket()
        queue = SendQueue(cast(Any, socket))
        writer = asyncio.create_task(queue.send_waiting())
        for _ in range(4):
            queue.put("12345", keep=True)
        waiting = asyncio.create_task(queue.wait_for_room())
        await asyncio.sleep(0)
        assert not waiting.done()
        socket.read.set()
        await asyncio.gather(writer, waiting)
        assert socket.sent == ["12345"] * 4
        await queue.wait_for_room()

    asyncio.run(run())


def test_a_new_message_is_dropped_when_the_queue_holds_undroppable_ones() -> None:
    async def run() -> None:
        socket = Socket()
        queue = SendQueue(cast(Any, socket))
        queue.put("kept 8 b", keep=True)
        for number in range(5):
            queue.put(b"%02d" % number, keep=False)
        assert queue.dropped == 4
        socket.read.set()
        await queue.send_waiting()
        assert socket.sent == ["kept 8 b", b"00"]

    asyncio.run(run())


def test_the_oldest_is_dropped_first() -> None:
    async def run() -> None:
        socket = Socket()
        queue = SendQueue(cast(Any, socket))
        for number in range(8):
            queue.put(b"%02d" % number, keep=False)
        assert queue.dropped == 3
        socket.read.set()
        await queue.send_waiting()
        assert socket.sent == [b"%02d" % number for number in range(3, 8)]

    asyncio.run(run())


class DisconnectedClient(SocketClient):
    """A client that sends nothing more, and to which nothing can be sent."""

    async def _read(self) -> None:
        await asyncio.sleep(0)

    async def _write(self) -> None:
        try:
            await asyncio.Event().wait()
        finally:
            raise ConnectionError("closing")

    _on_text = _on_binary = cast(Any, None)


def test_a_client_that_disconnects_while_sending_leaves_no_error() -> None:
    reported: list[dict[str, Any]] = []

    async def run() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda _, context: reported.append(context))
        await DisconnectedClient(cast(Any, Socket())).serve()

    asyncio.run(run())
    gc.collect()
    assert reported == []
