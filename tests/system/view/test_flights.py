"""`--view` of the commands that fly: the vehicles that the page offers."""

from pathlib import Path

import aiohttp
import pytest

from hil.commands.view.flights import FlightViewer
from hil.scenario.config import load_scenario
from tests.support.clients.view_client import ADDRESS, offered, with_session
from tests.support.processes import Program, write_scenario

pytest.importorskip("aiohttp", reason="the live view needs the extra view")

FLEET = ["uuv1", "uuv2", "uuv3", "uuv4"]


def vehicles_at(address: str, token: str) -> list[str]:
    async def ask(client: aiohttp.ClientSession) -> list[str]:
        async with client.get(f"{address}?token={token}") as page:
            assert page.status == 200
        return await offered(client, address)

    return with_session(ask)


def test_a_simulated_case_of_a_fleet_is_shown(tmp_path: Path) -> None:
    with Program(tmp_path, "case", "target_hunting", "--view", "--output", tmp_path / "out") as case:
        found = case.expect(ADDRESS)
        assert vehicles_at(found[1], found[2]) == FLEET
        assert "Traceback" not in case.output


def test_slaves_of_a_case_are_shown(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path, _ = write_scenario(tmp_path)
    with Program(tmp_path, "slave", path), FlightViewer().show_slaves(load_scenario(str(path))):
        address, _, token = capfd.readouterr().out.partition("watch at ")[2].strip().partition("?token=")
        assert vehicles_at(address, token) == ["uuv1"]
