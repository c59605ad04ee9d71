"""The live view's page as a person uses it: its fields and buttons, and the scene under the mouse."""

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import hil
from hil.client import samples
from hil.client.vehicle_handle import Vehicle
from hil.ros.diagnostics import Diagnostics
from tests.support.clients.browser import PATIENCE_MS, BrowserPage, open_page
from tests.support.clients.view_client import ADDRESS
from tests.support.processes import PATIENCE_S, Program, wait_for, write_scenario

READY = "document.getElementById('reason').textContent === 'ready'"
PAUSE_MS = 100
DRAWN_COLOURS = 12  # a scene with a seabed has more, an empty one fewer


class LastSamples:
    """The last samples of a vehicle, also when a busy machine has delayed it beyond its liveness timeout."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.client = vehicle.client
        self.client.watch("ground_truth")
        assert wait_for(lambda: self.client.latest.get("ground_truth")), f"{vehicle.name} says nothing"

    @property
    def ground_truth(self) -> samples.State:
        """True position and speed."""
        state: samples.State = samples.aged("ground_truth", self.client.latest["ground_truth"])
        return state

    @property
    def diagnostics(self) -> Diagnostics:
        """Figures of its health."""
        return self.client.diagnostics()


class ViewPage:
    """The view whose program printed its address, opened in a browser."""

    def __init__(self, browser_page: BrowserPage, view: Program) -> None:
        self.browser_page, self.page, self.view = browser_page, browser_page.page, view
        self.page.goto(view.expect(ADDRESS)[0].removeprefix("watch at "), timeout=PATIENCE_MS)

    def wait_until_ready(self) -> None:
        """Wait until the vehicle may be steered."""
        self.page.wait_for_function(READY, timeout=PATIENCE_MS)

    def wait_until(self, condition: Callable[[], bool], seconds: float = 120.0) -> bool:
        """Wait until the condition holds, while the page runs; return whether it does."""

        def is_reached() -> bool:
            self.page.wait_for_timeout(PAUSE_MS)
            return condition()

        return bool(wait_for(is_reached, seconds))

    def pixels(self) -> Any:
        """Return the scene as it is on the screen, without the small picture at its right."""
        shot = self.page.locator("#scene").screenshot(timeout=PATIENCE_MS)
        picture = np.asarray(Image.open(io.BytesIO(shot)).convert("RGB")).astype(int)
        return picture[:, : picture.shape[1] // 2]

    def wait_until_drawn(self) -> None:
        """Wait until there is a seabed: many colours on the screen."""

        def is_drawn() -> bool:
            return len(np.unique((self.pixels() // 16).reshape(-1, 3), axis=0)) > DRAWN_COLOURS

        assert self.wait_until(is_drawn, 180.0), "nothing is drawn"

    def click(self, name: str) -> None:
        """Press the button of that id."""
        self.page.locator(f"#{name}").click()

    def open(self, name: str) -> None:
        """Open the panel of that id."""
        self.page.locator(f"#{name} > summary").click()

    def choose(self, name: str, value: str) -> None:
        """Choose an entry of the list of that id."""
        self.page.locator(f"#{name}").select_option(value)

    def write(self, **values: float) -> None:
        """Enter numbers into the fields of those ids."""
        for name, value in values.items():
            self.page.locator(f"#{name}").fill(f"{value:g}")

    def show_scene(self, camera: str = "follow") -> None:
        """Show the scene large, by that camera, without anything over it."""
        self.page.locator("#tabs button", has_text="scene").click()
        self.choose("camera", camera)

    def middle(self) -> tuple[float, float]:
        """Return the middle of the scene on the screen (pixels); from above the vehicle is there."""
        box = self.page.locator("#scene").bounding_box()
        return box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]


@contextmanager
def viewed_slave(folder: Path, *options: object, script: str = "") -> Iterator[tuple[ViewPage, LastSamples, Program]]:
    """Provide a slave in the pool and a view of it in a browser: the page, the vehicle's samples, and the slave.

    `script` is run in the page before its own.
    """
    scenario, port = write_scenario(folder)
    command = ("view", "--scenario", scenario, "--listen", "127.0.0.1:0", "--no-browser", *options)
    with (
        Program(folder, "slave", scenario) as slave,
        Program(folder, *command) as view,
        hil.connect(f"tcp/127.0.0.1:{port}", observe=True, wait=PATIENCE_S) as fleet,
        open_page() as browser_page,
    ):
        browser_page.page.add_init_script(script)
        page = ViewPage(browser_page, view)
        yield page, LastSamples(fleet["uuv1"]), slave
        assert "Traceback" not in view.output
        assert not browser_page.errors, browser_page.errors


def steer_by_keyboard(page: ViewPage, vehicle: LastSamples) -> None:
    """Check that the vehicle moves, also on the screen, with the space bar and W held, and stops without them."""
    before, start = page.pixels(), vehicle.ground_truth.position
    page.page.keyboard.down("Space")
    page.page.keyboard.down("KeyW")

    def has_moved() -> bool:
        return bool(np.hypot(*np.subtract(vehicle.ground_truth.position, start)[:2]) > 0.8)

    assert page.wait_until(has_moved), "the keys do not move the vehicle"
    assert np.abs(page.pixels() - before).mean() > 1.0, "it moves, but not on the screen"
    page.page.keyboard.up("KeyW")
    page.page.keyboard.up("Space")
    assert page.wait_until(lambda: vehicle.ground_truth.speed < 0.05), "it goes on without a hand at the stick"
