"""The live view in a real browser: it opens without errors, the vehicle moves on the screen, its buttons act."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import hil
from hil.client.vehicle_handle import Vehicle
from tests.support.clients.browser import PATIENCE_MS, Seen, open_page
from tests.support.clients.view_client import ADDRESS
from tests.support.processes import Program, wait_for, write_scenario

pytest.importorskip("viser", reason="the live view needs the extra view")
pytestmark = pytest.mark.timeout(600)

LOADED = "document.getElementById('reason').textContent === 'ready'"
PAUSE_MS = 100


def pixels(seen: Seen) -> Any:
    """The scene as it is on the screen, without the panels at its right."""
    shot = seen.page.locator("#scene").screenshot(timeout=PATIENCE_MS)
    picture = np.asarray(Image.open(io.BytesIO(shot)).convert("RGB")).astype(int)
    return picture[:, : picture.shape[1] // 2]


def wait_until_drawn(seen: Seen) -> None:
    """Wait until there is a seabed: many colours on the screen."""

    def drawn() -> bool:
        seen.page.wait_for_timeout(PAUSE_MS)
        return len(np.unique((pixels(seen) // 16).reshape(-1, 3), axis=0)) > 12

    assert wait_for(drawn, 180.0), "nothing is drawn"


def test_it_shows_the_vehicle_steers_it_and_stops_it(tmp_path: Path) -> None:
    scenario, port = write_scenario(tmp_path)
    with (
        Program(tmp_path, "slave", scenario) as slave,
        Program(tmp_path, "view", "--scenario", scenario, "--listen", "127.0.0.1:0", "--no-browser") as view,
        hil.connect(f"tcp/127.0.0.1:{port}", observe=True) as fleet,
        open_page() as seen,
    ):
        found = view.expect(ADDRESS)
        seen.page.goto(found[0].removeprefix("watch at "), timeout=PATIENCE_MS)
        seen.page.wait_for_function(LOADED, timeout=PATIENCE_MS)
        wait_until_drawn(seen)
        vehicle = fleet["uuv1"]
        steer_by_keyboard(seen, vehicle)
        seen.page.locator("#stop").click()
        assert wait_for(lambda: vehicle.diagnostics.armed is False), "STOP disarms"
        seen.page.wait_for_function("document.getElementById('reason').textContent.includes('disarmed')")
        assert seen.page.locator("#switch").is_disabled()
        seen.page.locator("#arm").click()
        assert wait_for(lambda: vehicle.diagnostics.armed is True)
        assert seen.hosts <= {"127.0.0.1", ""}, "nothing is asked of another host"
        assert not seen.errors, seen.errors
        slave.stop(15)
        seen.page.wait_for_function("document.getElementById('reason').textContent.includes('not there')")
        with Program(tmp_path, "slave", scenario):
            seen.page.wait_for_function(LOADED, timeout=PATIENCE_MS)
        assert "Traceback" not in view.output


def steer_by_keyboard(seen: Seen, vehicle: Vehicle) -> None:
    """Hold the space bar and W: the vehicle moves, in the water and on the screen; let go, and it stops."""
    before, place = pixels(seen), vehicle.ground_truth.position
    seen.page.locator("#heading").focus()  # outside the scene, whose camera has keys of its own
    seen.page.keyboard.down("Space")
    seen.page.keyboard.down("KeyW")

    def moved() -> bool:
        seen.page.wait_for_timeout(PAUSE_MS)
        return bool(np.hypot(*np.subtract(vehicle.ground_truth.position, place)[:2]) > 0.8)

    assert wait_for(moved, 120.0), "the keys do not move the vehicle"
    assert np.abs(pixels(seen) - before).mean() > 1.0, "it moves, but not on the screen"
    seen.page.keyboard.up("KeyW")
    seen.page.keyboard.up("Space")

    def at_rest() -> bool:
        seen.page.wait_for_timeout(PAUSE_MS)
        return vehicle.ground_truth.speed < 0.05

    assert wait_for(at_rest, 120.0), "it goes on without a hand at the stick"


def test_a_recording_plays_pauses_and_goes_where_its_slider_is(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    scenario.write_text(scenario.read_text() + "[recording]\nslave = true\n")
    record = Program(tmp_path, "demo", scenario, "--output", tmp_path / "run", cwd=tmp_path)
    with record:
        assert record.wait() == 0, record.output
    recording = next(tmp_path.rglob("*.mcap"))
    with Program(tmp_path, "replay", recording, "--view") as view, open_page() as seen:
        found = view.expect(ADDRESS)
        seen.page.goto(found[0].removeprefix("watch at "), timeout=PATIENCE_MS)
        wait_until_drawn(seen)
        frame = seen.page.frame_locator("#scene")
        frame.get_by_text("pause", exact=True).click()
        frame.get_by_text("go on", exact=True).wait_for()
        assert not seen.errors, seen.errors
