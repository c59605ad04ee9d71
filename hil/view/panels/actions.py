"""The panel of actions: hold depth and heading, go to a position, fly waypoints, fail thrusters, reset, set a pose."""

import threading
from collections.abc import Callable, Sequence
from math import radians
from typing import Any

import numpy as np

from hil.client import services
from hil.client.vehicle_handle import Vehicle
from hil.common.errors import HilError, NetworkError
from hil.view.scene.frames import from_scene, to_scene

HANDLE_PIXELS = 60.0  # size of the arrows that drag a waypoint, at any distance of the camera
CLICK_ACTIONS = "click: nothing", "click: go there", "click: add a waypoint"


class ActionsPanel:
    """Buttons for one chosen vehicle. `chosen` returns it, or None if this view only observes.

    `report` is called with the outcome. `server` is a viser.ViserServer, `container` the tab that holds the panel,
    `thrusters` are the names of the vehicle's thrusters.
    """

    def __init__(
        self,
        server: Any,
        container: Any,
        chosen: Callable[[], Vehicle | None],
        report: Callable[[str], None],
        thrusters: Sequence[str],
    ) -> None:
        self._server, self._chosen, self._report = server, chosen, report
        self._waypoints: list[Any] = []
        self._buttons: list[Any] = []
        self._failed: set[str] = set()  # thrusters that this panel has made fail
        with container:
            self._reason = server.gui.add_markdown("")
            self._add_hold()
            self._add_places()
            self._add_simulated(thrusters)
        server.scene.on_click()(self._on_click)

    def show_reason(self, reason: str) -> None:
        """Show why the vehicle does not accept commands, and disable the buttons; "" enables them."""
        if self._reason.content != reason:
            self._reason.content = reason
            for button in self._buttons:
                button.disabled = bool(reason)
                button.hint = reason or None

    def _add_hold(self) -> None:
        gui = self._server.gui
        with gui.add_folder("hold"):
            depth = gui.add_number("depth (m)", 2.0, min=0.0, max=11_000.0, step=0.1)
            heading = gui.add_number("heading (°)", 0.0, min=-180.0, max=360.0, step=1.0)
            self._button("hold depth", lambda vehicle: vehicle.hold_depth(depth.value))
            self._button("hold heading", lambda vehicle: vehicle.hold_heading(_wrapped(heading.value)))
            self._button("stand still", lambda vehicle: vehicle.stop())
            self._button("send no more commands", lambda vehicle: vehicle.release())

    def _add_places(self) -> None:
        gui = self._server.gui
        with gui.add_folder("places"):
            self._click_action = gui.add_dropdown(
                "in the scene", CLICK_ACTIONS, hint="on the level at which the vehicle is"
            )
            self._speed = gui.add_number("speed (m/s)", 0.4, min=0.05, max=5.0, step=0.05)
            self._button("fly the waypoints", self._fly)
            clear = gui.add_button("remove the waypoints")
            clear.on_click(lambda _: self._clear())

    def _add_simulated(self, thrusters: Sequence[str]) -> None:
        gui = self._server.gui
        with gui.add_folder("simulated vehicle"):
            for name in thrusters:
                box = gui.add_checkbox(f"{name} has failed", False)
                box.on_update(lambda _, name=name, box=box: self._fail(name, box))
                self._buttons.append(box)
            self._button("back to the start", lambda vehicle: self._report(services.reset(vehicle)))
            position = gui.add_vector3("north, east, depth (m)", (0.0, 0.0, 1.0), step=0.1)
            heading = gui.add_number("at heading (°)", 0.0, min=-180.0, max=360.0, step=1.0)

            def put(vehicle: Vehicle) -> None:
                north, east, depth = position.value
                self._report(services.set_pose(vehicle, north, east, depth, radians(heading.value)))

            self._button("put it there", put)

    def _button(self, label: str, act: Callable[[Vehicle], object]) -> None:
        button = self._server.gui.add_button(label)
        button.on_click(lambda _: self._do(label, act))
        self._buttons.append(button)

    def _fail(self, thruster: str, box: Any) -> None:
        """Fail or repair a thruster as its check box says; reset the box if the request is refused."""
        failing = bool(box.value)
        if failing == (thruster in self._failed):
            return

        def act(vehicle: Vehicle) -> None:
            self._report(services.fail_thruster(vehicle, thruster, "off" if failing else "repaired"))
            (self._failed.add if failing else self._failed.discard)(thruster)

        def go_back() -> None:
            box.value = thruster in self._failed

        self._do(f"failure of {thruster}", act, go_back)

    def _do(self, label: str, act: Callable[[Vehicle], object], on_refusal: Callable[[], None] = lambda: None) -> None:
        """Run the action in a thread, because it may wait for the vehicle's answer."""

        def run() -> None:
            vehicle = self._chosen()
            try:
                if vehicle is None:
                    raise NetworkError("this view only observes")
                act(vehicle)
                self._report(f"{vehicle.name}: {label}")
            except HilError as error:
                self._report(f"{label}: {error}")
                on_refusal()

        threading.Thread(target=run, name=label, daemon=True).start()

    def _on_click(self, event: Any) -> None:
        vehicle = self._chosen()
        chosen = CLICK_ACTIONS.index(self._click_action.value)
        if vehicle is None or not chosen or event.ray_origin is None:
            return
        try:
            depth = vehicle.state.depth
        except HilError as error:
            self._report(str(error))
            return
        origin, along = np.array(event.ray_origin), np.array(event.ray_direction)
        if abs(along[2]) < 1e-6 or (reach := (-depth - origin[2]) / along[2]) <= 0.0:
            self._report("that place is not on the level of the vehicle: look from above")
            return
        north, east, _ = from_scene(origin + reach * along)
        if chosen == 1:
            self._do(f"go to ({north:.1f}, {east:.1f}) m", lambda vehicle: vehicle.go_to(north, east, depth))
        else:
            self._add_waypoint(north, east, depth)

    def _add_waypoint(self, north: float, east: float, depth: float) -> None:
        number = len(self._waypoints) + 1
        handle = self._server.scene.add_transform_controls(
            f"/waypoints/{number}", scale=HANDLE_PIXELS, fixed=True, depth_test=False, disable_rotations=True,
            position=to_scene([(north, east, depth)])[0],
        )  # fmt: skip
        self._server.scene.add_label(f"/waypoints/{number}/name", str(number), position=(0.0, 0.0, 0.4))
        self._waypoints.append(handle)

    def _fly(self, vehicle: Vehicle) -> None:
        points = [from_scene(handle.position) for handle in self._waypoints]
        if not points:
            self._report("no waypoints yet: choose 'click: add a waypoint', and click in the scene")
            return
        listed = ", ".join(f"({north:.1f}, {east:.1f}, {depth:.1f})" for north, east, depth in points)
        self._report(f"waypoints (north, east, depth in m): {listed}")
        vehicle.follow(points, speed=float(self._speed.value))

    def _clear(self) -> None:
        for handle in self._waypoints:
            handle.remove()
        self._waypoints = []


def _wrapped(angle: float) -> float:
    """Return degrees as radians from -pi to pi."""
    return radians((angle + 180.0) % 360.0 - 180.0)
