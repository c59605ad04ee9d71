"""Frames of the scene in a browser that renders in software, in processor time: others use the machine too."""

from pathlib import Path

import psutil
import pytest

from tests.support.clients.view_page import ViewPage, viewed_slave

pytest.importorskip("aiohttp", reason="the live view needs the extra view")
pytestmark = pytest.mark.timeout(600)

FRAMES, ROUNDS = 20, 3
MOST = 2.3  # times the processor time of a picture of one colour over the whole panel: 1.8 measured
FEED = "(took) => { for (let n = 0; n < 1500; n++) { at += took; scene.adapt(at); } return scene.sharpness; }"
BEGIN = "window.scene = sceneOfPage; ({gl, draw: view, adapt} = scene); scene.adapt = () => {}"
VIEW = "scene.sharpness = 0.3; scene.draw = view; hud.style.display = ''"
CLEAR = "hud.style.display = 'none'; scene.draw = now => { gl.clearColor(now % 1, 0, 0, 1); gl.clear(16384); }"
DRAW = "count => new Promise(done => { const step = () => count-- ? requestAnimationFrame(step) : done(); step(); })"


def drawing_time(page: ViewPage, script: str) -> float:
    """Return the processor time (s) a frame of the process that draws, after `script`."""
    page.page.evaluate(script)
    page.page.evaluate(DRAW, 3)
    (process,) = [each for each in psutil.Process().children(True) if "--type=gpu-process" in each.cmdline()]
    before = sum(process.cpu_times()[:2])
    page.page.evaluate(DRAW, FRAMES)
    return float(sum(process.cpu_times()[:2]) - before) / FRAMES


def test_the_scene_is_drawn_at_the_rate_that_the_machine_allows(tmp_path: Path) -> None:
    with viewed_slave(tmp_path) as (page, _, _):
        page.page.set_viewport_size({"width": 1920, "height": 1080})
        page.wait_until_ready()
        page.show_scene()
        page.wait_until_drawn()
        page.page.evaluate(BEGIN)
        view, least = (sum(each) / ROUNDS for each in zip(*[
            [drawing_time(page, script) for script in (VIEW, CLEAR)] for _ in range(ROUNDS)
        ], strict=True))  # fmt: skip
        print(f"1920 x 1080: {1000 * view:.0f} ms of processor time a frame, {1000 * least:.0f} ms for one colour")
        assert view < MOST * least
        page.page.evaluate("scene.adapt = adapt; window.at = 1e7; scene.isPaused = false; scene.draw = () => {}")
        assert page.page.evaluate(FEED, 120.0) == pytest.approx(0.3), "few pixels where frames are slow"
        assert page.page.evaluate(FEED, 16.0) == pytest.approx(1.0), "all of them where they are fast"
