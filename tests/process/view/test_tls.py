"""The page of the live view over TLS."""

import ssl
from importlib.util import find_spec
from pathlib import Path

import aiohttp
import pytest

from hil.commands.keys import add_machine, init
from tests.support.clients.view_client import ADDRESS, offered, with_session
from tests.support.processes import Program, free_port, write_scenario

pytestmark = pytest.mark.skipif(find_spec("aiohttp") is None, reason="the live view needs the extra view")


def machine(folder: Path) -> Path:
    """Return a folder with the certificates of the machine 127.0.0.1."""
    init(str(folder))
    add_machine(str(folder), "bench", ["127.0.0.1"])
    return folder / "bench"


def test_page_joystick_and_scene_are_encrypted(tmp_path: Path) -> None:
    keys = machine(tmp_path / "keys")
    scenario, _ = write_scenario(tmp_path)
    words = ("--cert", keys / "cert.pem", "--key", keys / "key.pem", "--listen", "127.0.0.1:0", "--no-browser")
    with Program(tmp_path, "slave", scenario), Program(tmp_path, "view", "--scenario", scenario, *words) as view:
        address, token = view.expect(ADDRESS).groups()
        assert address.startswith("https://")
        trusting = ssl.create_default_context(cafile=str(keys / "ca.pem"))

        async def read_replies(client: aiohttp.ClientSession) -> list[str]:
            async with client.get(f"{address}?token={token}") as page:
                assert "STOP" in await page.text()
            return await offered(client, address)

        assert with_session(read_replies, trusting) == ["uuv1"]


def test_a_view_for_other_machines_without_certificates_warns(tmp_path: Path) -> None:
    words = ("--connect", f"tcp/127.0.0.1:{free_port()}", "--listen", "0.0.0.0:0", "--no-browser")
    with Program(tmp_path, "view", *words) as view:
        view.expect(ADDRESS)
        view.expect("WARNING: the view listens beyond this machine without encryption")
