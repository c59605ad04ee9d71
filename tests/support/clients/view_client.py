"""An HTTP client in place of a browser: the page, the websocket of the joystick, the websocket of the samples."""

import asyncio
import ssl
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

import aiohttp

T = TypeVar("T")
ADDRESS = r"watch at (https?://\S+/)\?token=(\S+)"


def with_session(work: Callable[[aiohttp.ClientSession], Awaitable[T]], tls: ssl.SSLContext | bool = True) -> T:
    """Run `work` with a client that stores cookies; `tls` has the certificates that it trusts."""

    async def run() -> T:
        async with aiohttp.ClientSession(
            cookie_jar=aiohttp.CookieJar(unsafe=True), connector=aiohttp.TCPConnector(ssl=tls)
        ) as client:
            found = await work(client)
        await asyncio.sleep(0.1)  # what aiohttp needs to close its connections
        return found

    return asyncio.run(run())


def stick(held: bool = False, acts: tuple[str, ...] = (), vehicle: str = "uuv1", **axes: float) -> dict[str, Any]:
    """Return a joystick message."""
    pressed = [{"do": act} for act in acts]
    return {"vehicle": vehicle, "held": held, "axes": axes, "mode": "velocity", "acts": pressed}


async def samples_until(
    client: aiohttp.ClientSession,
    address: str,
    take: Callable[[dict[str, Any]], object],
    pictures: tuple[str, ...] = (),
) -> None:
    """Receive samples as the page does and answer each message, until `take` of its values returns something true."""
    async with client.ws_connect(f"{address}live", max_msg_size=0) as socket:
        async for message in socket:
            if message.type is aiohttp.WSMsgType.TEXT:
                await socket.send_json({"vehicle": "uuv1", "pictures": []})
                if take(message.json()["values"]):
                    return


async def offered(client: aiohttp.ClientSession, address: str) -> list[str]:
    """Return the vehicles that the page offers, once there are any."""
    async with client.ws_connect(f"{address}stick") as socket:
        for _ in range(600):
            await socket.send_json(stick(vehicle=""))
            names = (await socket.receive_json(timeout=30.0)).get("vehicles")
            if names:
                return [str(name) for name in names]
            await asyncio.sleep(0.05)
    return []
