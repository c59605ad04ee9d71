"""`uuv-hil sim --view` of a vehicle with an autopilot."""

from pathlib import Path

import aiohttp
import pytest

from hil.common.ports import free_ports
from tests.support.autopilots.autopilot_flyer import SCENARIO, Flyer
from tests.support.clients.view_client import ADDRESS, offered, samples_until, with_session
from tests.support.processes import Program, free_port

pytest.importorskip("aiohttp", reason="the live view needs the extra view")


def test_a_simulated_flight_is_shown_in_the_live_view(tmp_path: Path) -> None:
    udp, path = free_ports(1)[0], tmp_path / "watched.toml"
    text = SCENARIO.format(stm32="python", port=free_port(), udp=udp)
    path.write_text(text.replace("master = {}", "master = { time_limit = 5 }"))
    with Program(tmp_path, "sim", path, "--view") as sim:
        found = sim.expect(ADDRESS)
        flyer = Flyer(udp)
        try:
            seen = with_session(lambda client: watch(client, found[1], found[2]))
            assert sim.wait() == 0, sim.output
        finally:
            flyer.close()
    assert seen == ["uuv1"]
    assert "5.0 s simulated" in sim.output


async def watch(client: aiohttp.ClientSession, address: str, token: str) -> list[str]:
    """Return the vehicles that the page offers, once its samples have arrived."""
    async with client.get(f"{address}?token={token}") as page:
        assert page.status == 200
    await samples_until(client, address, lambda values: (values.get("motion") or {}).get("uuv1"))
    return await offered(client, address)
