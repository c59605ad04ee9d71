"""The live view over a network of 20 Mbit/s, by a relay, as not every kernel has netem."""

import asyncio
import time
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.bench.harness import Bench, await_vehicle
from hil.client.client import VehicleClient
from hil.common.quantiles import quantile
from hil.ros import encoders as ros
from tests.support.clients.browser import PATIENCE_MS
from tests.support.clients.view_client import ADDRESS, samples_until
from tests.support.clients.view_page import steer_by_keyboard, viewed_slave
from tests.support.processes import Program
from tools.faults.relay import Relay

pytest.importorskip("aiohttp", reason="the live view needs the extra view")
pytestmark = pytest.mark.timeout(900)

RATE_MBIT_S = 20.0
MAX_LATENCY_MS = 60.0
VIEWERS = 3
SETTLE_S, MEASURED_S = 8.0, 15.0  # the seabed has gone through after the first
WORLD = """
name = "wide"
source = "made up: displaced midpoints"
extent = [-499.5, 499.5, -499.5, 499.5]
depth = 30.0
[terrain]
kind = "fractal"
depth = 30.0
deviation = 4.0
hurst = 0.8
seed = 1
resolution = 1.0
"""
SCENARIO = """
vehicle = "paper_six"
world = "{world}"
[start]
depth = 5
[master]
goal = [8, 7]
depth = 5
"""
Place = tuple[float, ...]


def rounded(position: Any) -> Place:
    return tuple([round(float(value), 5) for value in position])


async def watch(address: str, token: str, measured_ns: dict[Place, int], ages_ms: list[float]) -> None:
    """Receive what the page does; append how late each new place of the vehicle comes."""
    end = time.monotonic() + SETTLE_S + MEASURED_S

    def take(values: dict[str, Any]) -> bool:
        moving = (values.get("motion") or {}).get("uuv1")
        came = measured_ns.get(rounded(moving["position"])) if moving else None
        if came and time.monotonic() > end - MEASURED_S:
            ages_ms.append((time.time_ns() - came) / 1e6)
        return time.monotonic() > end

    async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as client:
        async with client.get(f"{address}?token={token}") as page:
            page.raise_for_status()
        async with client.get(f"{address}content") as content:
            await content.read()
        await samples_until(client, address, take)


def test_the_shown_position_does_not_fall_behind(tmp_path: Path) -> None:
    """Three viewers see a seabed of 1,000 x 1,000: a sample is shown soon, and at the end as soon as at the start."""
    (tmp_path / "wide.toml").write_text(WORLD)
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(SCENARIO.format(world=tmp_path / "wide.toml"))
    measured_ns: dict[Place, int] = {}

    def on_truth(topic: str, payload: bytes, attachment: bytes) -> None:
        decode, stamp = ros.decoder(topic), ros.unpack_attachment(attachment)
        if decode and stamp and (state := decode(payload)):
            measured_ns[rounded(state.position)] = stamp.time_ns

    with Bench(str(scenario)) as bench:
        slave = bench.start_slave()
        with bench.client(topics=("ground_truth", "trace")) as client:
            client.session.subscribe("uuv1", "ground_truth", on_truth, 64)
            await_vehicle(client, slave)
            command = ("view", "--scenario", bench.path, "--listen", "127.0.0.1:0", "--no-browser")
            with Program(tmp_path, *command) as view:
                found = view.expect(ADDRESS)
                port = int(found[1].rstrip("/").rpartition(":")[2])
                with Relay(port, RATE_MBIT_S * 1e6 / 8, slow=(0,)) as relay:
                    ages_ms = view_and_fly(client, f"http://127.0.0.1:{relay.port}/", found[2], measured_ns)
                    assert relay.passed > 300_000, "the scene came another way"
    third = len(ages_ms) // 3
    begin, end = (quantile(sorted(part), 0.5) for part in (ages_ms[:third], ages_ms[-third:]))
    print(f"{len(ages_ms)} updates, {begin:.0f} then {end:.0f} ms")
    assert len(ages_ms) > 5.0 * MEASURED_S
    assert begin < MAX_LATENCY_MS
    assert end < begin + 300.0, "what is shown falls behind"


def view_and_fly(client: VehicleClient, address: str, token: str, measured_ns: dict[Place, int]) -> list[float]:
    """Fly a circle while viewers watch; return how late (ms) the first of them got each place."""
    ages: list[list[float]] = [[] for _ in range(VIEWERS)]

    async def fly() -> None:
        while True:
            client.command(VelocityCommand(surge=0.3, yaw_rate=0.2, depth=5.0))
            await asyncio.sleep(0.05)

    async def all_watch() -> None:
        flying = asyncio.create_task(fly())
        await asyncio.gather(*[watch(address, token, measured_ns, each) for each in ages])
        flying.cancel()

    asyncio.run(all_watch())
    return ages[0]


def test_a_browser_steers_over_a_slow_network(tmp_path: Path) -> None:
    with viewed_slave(tmp_path) as (page, vehicle, _):
        port = int(page.page.url.partition("//")[2].partition("/")[0].rpartition(":")[2])
        with Relay(port, RATE_MBIT_S * 1e6 / 8, slow=(0,)) as relay:
            found = page.view.expect(ADDRESS)
            page.page.goto(f"http://127.0.0.1:{relay.port}/?token={found[2]}", timeout=PATIENCE_MS)
            page.wait_until_ready()
            page.wait_until_drawn()
            steer_by_keyboard(page, vehicle)
            assert relay.passed > 100_000, "the page came another way"
