"""The live view in a real browser: it opens without errors, shows the moving vehicle, and its controls work."""

import re
import time
from pathlib import Path

import numpy as np
import pytest

from tests.support.clients.browser import open_page
from tests.support.clients.view_page import ViewPage, steer_by_keyboard, viewed_slave
from tests.support.processes import Program, write_scenario

pytest.importorskip("aiohttp", reason="the live view needs the extra view")
pytestmark = pytest.mark.timeout(600)
# A flight of some minutes: it still goes on when a browser without a graphics card has drawn the scene.
SLOW = ("--set", "master.speed=0.05", "--set", "master.goal=[-8, -8]", "--set", "master.time_limit=900")


def test_the_view_shows_steers_and_stops_the_vehicle(tmp_path: Path) -> None:
    with viewed_slave(tmp_path) as (page, vehicle, slave):
        page.wait_until_ready()
        page.wait_until_drawn()
        steer_by_keyboard(page, vehicle)
        page.page.locator("#stop").click()
        assert page.wait_until(lambda: vehicle.diagnostics.armed is False), "STOP disarms"
        page.page.wait_for_function("document.getElementById('reason').textContent.includes('disarmed')")
        assert page.page.locator("#switch").is_disabled()
        page.page.locator("#arm").click()
        assert page.wait_until(lambda: vehicle.diagnostics.armed is True)
        assert page.browser_page.hosts <= {"127.0.0.1", ""}, "no other host gets a request"
        slave.stop(15)
        page.page.wait_for_function("document.getElementById('reason').textContent.includes('not connected')")
        with Program(tmp_path, "slave", tmp_path / "short.toml"):
            page.wait_until_ready()


GAMEPAD = """
window.pad = {id: "Test Pad (STANDARD GAMEPAD)", connected: true, index: 0, mapping: "standard",
              axes: [0, 0, 0, 0], buttons: Array.from({length: 17}, () => ({pressed: false, value: 0}))};
navigator.getGamepads = () => [null, window.pad];
"""


def test_a_gamepad_steers_while_its_enable_button_is_held(tmp_path: Path) -> None:
    """The browser's own code reads a simulated gamepad whose left stick is pushed forward."""
    with viewed_slave(tmp_path, script=GAMEPAD) as (page, vehicle, _):
        page.wait_until_ready()
        page.page.wait_for_function("document.getElementById('pad').textContent.includes('Test Pad')")
        place, heading = vehicle.ground_truth.position, vehicle.ground_truth.heading
        page.page.evaluate("pad.axes[1] = -1.0")
        page.page.wait_for_timeout(1500)
        assert np.hypot(*np.subtract(vehicle.ground_truth.position, place)[:2]) < 0.05, "it moves without its switch"
        page.page.evaluate("pad.buttons[4].pressed = true")

        def ahead() -> float:
            north, east = np.subtract(vehicle.ground_truth.position, place)[:2]
            return float(north * np.cos(heading) + east * np.sin(heading))

        assert page.wait_until(lambda: ahead() > 0.5), "the stick does not drive it ahead"
        page.page.evaluate("pad.axes[1] = 0.0; pad.axes[0] = 1.0")
        assert page.wait_until(lambda: np.sin(vehicle.ground_truth.heading - heading) > 0.3), "it does not turn right"
        page.page.evaluate("pad.axes[0] = 0.05")  # within its middle
        page.page.evaluate("pad.buttons[4].pressed = false; pad.axes[1] = -1.0")
        assert page.wait_until(lambda: vehicle.ground_truth.speed < 0.05), "it goes on with the switch let go"


def test_a_recording_plays_pauses_and_seeks(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    scenario.write_text(scenario.read_text() + "[recording]\nslave = true\n")
    record = Program(tmp_path, "demo", scenario, "--output", tmp_path / "run", cwd=tmp_path)
    with record:
        assert record.wait() == 0, record.output
    recording = next(tmp_path.rglob("*.mcap"))
    with Program(tmp_path, "recording", "replay", recording, "--view") as view, open_page() as seen:
        page = ViewPage(seen, view)
        page.wait_until_drawn()
        page.click("pause")
        page.page.get_by_text("go on", exact=True).wait_for()
        stands = seconds_shown(page)
        page.page.locator("#seek").fill("3.0")
        assert page.wait_until(lambda: abs(seconds_shown(page) - 3.0) < 0.11), f"still at {stands} s"
        page.page.wait_for_timeout(1500)
        assert abs(seconds_shown(page) - 3.0) < 0.11, "it plays on"
        assert not seen.errors, seen.errors


def seconds_shown(page: ViewPage) -> float:
    """Return the time (s) that the time panel shows."""
    return float(page.page.locator("#seconds").inner_text())


def test_simulated_time_is_paused_stepped_and_sped_up(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    with Program(tmp_path, "sim", scenario, "--view", *SLOW) as sim, open_page() as seen:
        page = ViewPage(seen, sim)
        page.wait_until_drawn()
        page.click("pause")
        page.page.get_by_text("go on", exact=True).wait_for()
        page.page.wait_for_timeout(1000)
        paused, before = seconds_shown(page), page.pixels()
        page.page.wait_for_timeout(2000)
        assert seconds_shown(page) == paused, "time goes on"
        assert np.abs(page.pixels() - before).mean() < 0.5, "the vehicle moves on the screen"
        for _ in range(4):
            page.click("step")
        assert page.wait_until(lambda: seconds_shown(page) > paused)
        page.page.wait_for_timeout(1000)
        assert seconds_shown(page) - paused == pytest.approx(0.2, abs=0.11), "four steps of 0.05 s"
        page.choose("speed", "50")
        began = time.monotonic()
        page.click("pause")
        assert sim.wait() == 0, sim.output
        took = time.monotonic() - began
    found = re.search(r"after ([0-9.]+) s simulated", sim.output)
    assert found, sim.output
    assert took < float(found[1]) - paused, "it is not faster than real time"


def test_touch_sticks_steer_on_a_phone(tmp_path: Path) -> None:
    """One thumb pushes ahead, another to starboard; the vehicle stops when both are lifted."""
    with viewed_slave(tmp_path) as (page, vehicle, _):
        page.page.set_viewport_size({"width": 390, "height": 700})
        page.wait_until_ready()
        screen, thumbs = page.page.context.new_cdp_session(page.page), list[dict[str, float]]()
        for stick, x, y in (("left", 56, 16), ("right", 96, 56)):  # pixels from the corner of a stick of 112
            box = page.page.locator(f"#{stick}stick").bounding_box()
            thumbs.append({"x": box["x"] + x, "y": box["y"] + y, "id": len(thumbs)})
            screen.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": thumbs})
        start = vehicle.ground_truth.position[:2]  # heading north
        both = page.wait_until(lambda: bool(np.subtract(vehicle.ground_truth.position[:2], start).min() > 0.3))
        assert both, "the thumbs do not move the vehicle ahead and aside"
        screen.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        assert page.wait_until(lambda: vehicle.ground_truth.speed < 0.05), "it goes on with the thumbs lifted"
