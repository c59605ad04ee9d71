"""`uuv-hil view` with a real slave: access by token, the scene, and control by a joystick."""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import aiohttp
import pytest

import hil
from tests.support.clients.view_client import ADDRESS, samples_until, stick, with_session
from tests.support.processes import PATIENCE_S, Program, write_scenario

pytest.importorskip("aiohttp", reason="the live view needs the extra view")


@contextmanager
def viewed(folder: Path, *options: str) -> Iterator[tuple[str, str, Program]]:
    """Provide a slave and a view of it: the view's address, its token, and its program."""
    scenario, _ = write_scenario(folder)
    words = ("view", "--scenario", scenario, "--listen", "127.0.0.1:0", "--no-browser", *options)
    with Program(folder, "slave", scenario), Program(folder, *words) as view:
        found = view.expect(ADDRESS)
        yield found[1], found[2], view


async def status(client: aiohttp.ClientSession, url: str, headers: dict[str, str] | None = None) -> int:
    async with client.get(url, headers=headers) as answer:
        await answer.read()
        return answer.status


async def talk(client: aiohttp.ClientSession, address: str, seconds: float, **message: Any) -> dict[str, Any]:
    """Send a joystick message 20 times a second; return the last reply."""
    answer: dict[str, Any] = {}
    async with client.ws_connect(f"{address}stick") as socket:
        for _ in range(round(seconds * 20)):
            await socket.send_json(stick(**message))
            answer = await socket.receive_json(timeout=30.0)
            message["acts"] = ()
            await asyncio.sleep(0.05)
    return answer


async def until(
    client: aiohttp.ClientSession, address: str, holds: Callable[[dict[str, Any]], Any], acts: tuple[str, ...] = ()
) -> None:
    """Press buttons, and wait until the reply is as it should be."""
    for _ in range(300):
        answer = await talk(client, address, 0.05, acts=acts)
        if holds(answer):
            return
        acts = ()
        await asyncio.sleep(0.1)
    raise AssertionError(answer)


def test_access_needs_the_token_and_the_origin_of_the_page(tmp_path: Path) -> None:
    with viewed(tmp_path) as (address, token, _):

        async def try_it(client: aiohttp.ClientSession) -> None:
            for path in ("", "stick", "live", "content", "main.js", "?token=wrong"):
                assert await status(client, address + path) == 403
            async with client.get(f"{address}?token={token}") as page:
                assert page.status == 200
                assert "STOP" in await page.text()
                assert "default-src 'self'" in page.headers["Content-Security-Policy"]
                assert str(page.url) == address, "the token does not stay in the address"
            assert await status(client, f"{address}main.js") == 200
            assert await status(client, f"{address}none.js") == 404
            elsewhere = {"Origin": "http://evil.example"}
            assert await status(client, address, elsewhere) == 403
            for socket in ("stick", "live"):
                with pytest.raises(aiohttp.WSServerHandshakeError):
                    await client.ws_connect(f"{address}{socket}", headers=elsewhere)
            await samples_until(client, address, lambda values: (values.get("motion") or {}).get("uuv1"))
            async with client.get(f"{address}content") as content:
                assert b'"rows"' in await content.read(), "the world of the scenario"

        with_session(try_it)


def test_a_vehicle_of_another_master_is_taken_over_and_given_back(tmp_path: Path) -> None:
    with viewed(tmp_path) as (address, token, _):
        scenario = tmp_path / "short.toml"
        endpoint = next(line for line in scenario.read_text().splitlines() if "listen" in line).split('"')[1]
        with hil.connect(endpoint, wait=PATIENCE_S) as fleet:
            fleet["uuv1"].drive(0.1)

            async def press(client: aiohttp.ClientSession) -> None:
                assert await status(client, f"{address}?token={token}") == 200
                await until(client, address, lambda answer: answer.get("may_take"))
                answer = await talk(client, address, 0.2, held=True, surge=1.0)
                assert not answer["may_steer"], "it is not taken over by the stick alone"
                await until(client, address, lambda answer: answer.get("taken") and answer["may_steer"], acts=("take",))
                await until(client, address, lambda answer: not answer.get("taken"), acts=("give",))

            with_session(press)


def test_the_joystick_steers_releases_and_stops_the_vehicle(tmp_path: Path) -> None:
    with viewed(tmp_path) as (address, token, view):

        async def steer(client: aiohttp.ClientSession) -> None:
            assert await status(client, f"{address}?token={token}") == 200
            await until(client, address, lambda answer: answer.get("may_steer"))
            answer = await talk(client, address, 3.0, held=True, surge=1.0)
            assert answer["text"] == "ready", answer
            assert answer["vehicles"] == ["uuv1"]
            stopped = await talk(client, address, 0.2, acts=("stop",))
            assert stopped["may_stop"]
            assert "rror" not in stopped["text"]
            for _ in range(100):
                answer = await talk(client, address, 0.1)
                if answer["armed"] is False:
                    break
            assert "disarmed" in answer["text"], answer
            assert not answer["may_steer"]

        with_session(steer)
        assert view.process.poll() is None
        assert "Traceback" not in view.output


def test_an_observer_cannot_steer(tmp_path: Path) -> None:
    with viewed(tmp_path, "--observe") as (address, token, _):

        async def try_it(client: aiohttp.ClientSession) -> dict[str, Any]:
            assert await status(client, f"{address}?token={token}") == 200
            answer: dict[str, Any] = {}
            for _ in range(100):
                answer = await talk(client, address, 0.1, held=True, surge=1.0, acts=("stop",))
                if answer.get("vehicles"):
                    break
            return answer

        answer = with_session(try_it)
        assert answer["text"] == "this view only observes"
        assert not answer["may_stop"]
        assert not answer["may_steer"]
