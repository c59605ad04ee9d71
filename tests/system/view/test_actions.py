"""The buttons of the live view in a real browser: each acts on the vehicle."""

from math import atan2, degrees, hypot
from pathlib import Path

import pytest

from tests.support.clients.view_page import LastSamples, ViewPage, viewed_slave

pytest.importorskip("aiohttp", reason="the live view needs the extra view")
pytestmark = pytest.mark.timeout(900)

CLICK_UP, DRAG_RIGHT = 60, 90  # pixels of the scene


def thrust(vehicle: LastSamples, thruster: str) -> float:
    """Return the force of a thruster now (N)."""
    stamped = vehicle.client.latest.get("joint_states")
    return abs(dict(zip(stamped.value.names, stamped.value.efforts, strict=True))[thruster]) if stamped else 0.0


def test_a_waypoint_is_set_dragged_and_reached(tmp_path: Path) -> None:
    """The view is from above with north up: the waypoint is set north of the vehicle, and dragged east."""
    with viewed_slave(tmp_path) as (page, vehicle, _):
        page.wait_until_ready()
        page.wait_until_drawn()
        start = vehicle.ground_truth.position
        page.show_scene("top")
        page.open("go")
        page.page.locator("[data-click=add]").click()
        page.page.wait_for_timeout(1500)
        x, y = page.middle()
        page.page.mouse.click(x, y - CLICK_UP)
        drag(page, (x, y - CLICK_UP), DRAG_RIGHT)
        page.click("fly")
        assert page.wait_until(lambda: hypot(*displacement(vehicle, start)) > 0.5), "it does not fly"
        assert page.wait_until(lambda: vehicle.ground_truth.speed < 0.03), "it does not end there"
        north, east = displacement(vehicle, start)
        bearing = degrees(atan2(east, north))
        expected = degrees(atan2(DRAG_RIGHT, CLICK_UP))
        assert abs(bearing - expected) < 12.0, f"flown to {bearing:.0f} degrees, dragged to {expected:.0f}"


def drag(page: ViewPage, begin: tuple[float, float], right: float) -> None:
    """Drag the object at `begin` to the right, as slowly as a hand does."""
    page.page.wait_for_timeout(1500)
    page.page.mouse.move(*begin)
    page.page.wait_for_timeout(1000)
    page.page.mouse.down()
    for step in range(1, 11):
        page.page.mouse.move(begin[0] + right * step / 10, begin[1])
        page.page.wait_for_timeout(150)
    page.page.mouse.up()
    page.page.wait_for_timeout(1500)


def displacement(vehicle: LastSamples, start: tuple[float, ...]) -> tuple[float, float]:
    """Return how far north and east of `start` the vehicle is (m)."""
    position = vehicle.ground_truth.position
    return position[0] - start[0], position[1] - start[1]


def test_buttons_for_failures_depth_and_pose_work(tmp_path: Path) -> None:
    with viewed_slave(tmp_path) as (page, vehicle, slave):
        vehicle.client.watch("joint_states")
        page.wait_until_ready()
        assert page.wait_until(lambda: page.page.locator("#holddepth").input_value() == "2.0"), "the present depth"
        page.write(holddepth=3.0)
        page.page.locator("#withheading").uncheck()
        page.click("hold")
        assert page.wait_until(lambda: abs(vehicle.ground_truth.position[2] - 3.0) < 0.1), "hold"
        page.open("disturb")
        page.open("steer")
        page.choose("failthruster", "front_right")
        page.click("fail")
        page.choose("mode", "effort")  # a turn on the spot, by all horizontal thrusters
        page.page.locator("#disturb summary").focus()
        page.page.keyboard.down("Space")
        page.page.keyboard.down("KeyD")

        def failed() -> bool:
            return thrust(vehicle, "rear_left") > max(1.0, 10.0 * thrust(vehicle, "front_right"))

        assert page.wait_until(failed), slave.output
        page.page.get_by_role("button", name="repair").click()
        assert page.wait_until(lambda: thrust(vehicle, "front_right") > 1.0), slave.output
        page.page.keyboard.up("KeyD")
        page.page.keyboard.up("Space")
        assert page.wait_until(lambda: vehicle.ground_truth.speed < 0.05)
        page.write(north=0.0, east=0.0, down=1.0, bow=0.0)
        page.click("pose")
        assert page.wait_until(lambda: hypot(*vehicle.ground_truth.position[:2]) < 0.3), "put it there"
        page.click("reset")
        assert page.wait_until(lambda: hypot(*displacement(vehicle, (4.0, 4.0))) < 0.3), "back to the start"


def test_an_observer_has_no_buttons_and_the_page_its_own_colours(tmp_path: Path) -> None:
    with viewed_slave(tmp_path, "--observe") as (page, vehicle, _):
        page.page.wait_for_function("document.getElementById('reason').textContent === 'this view only observes'")
        for name in ("stop", "switch", "hold", "fail"):
            assert page.page.locator(f"#{name}").is_disabled(), name
        assert vehicle.diagnostics.armed
        background = "getComputedStyle(document.querySelector('header')).backgroundColor"
        of_the_system = page.page.evaluate(background)
        page.click("layers")
        page.choose("theme", "dark")
        assert page.page.evaluate(background) != of_the_system, "dark"
        page.page.reload()
        page.page.wait_for_function(f"{background} !== '{of_the_system}'")  # this browser remembers it
