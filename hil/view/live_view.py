"""The live view: a scene and panels of some vehicles in the browser, updated about 20 times a second."""

from collections.abc import Mapping, Sequence
from math import dist
from ssl import SSLContext
from types import MappingProxyType
from typing import Any, NamedTuple

from hil.client import services
from hil.client.vehicle_handle import Vehicle
from hil.common.errors import HilError
from hil.ros.topics import first_of
from hil.view.page_server import PageServer
from hil.view.panels import instruments, pictures
from hil.view.panels.actions import ActionsPanel
from hil.view.panels.panels import Panels
from hil.view.panels.playback import PlaybackPanel
from hil.view.panels.recording import RecordingPanel
from hil.view.scene.fleet import FleetScene, Hunt
from hil.view.scene.following import CAMERA_OFFSET, move_camera
from hil.view.scene.sensors import SensorScene
from hil.view.scene.server import SceneServer
from hil.view.scene.vehicle import VehicleScene
from hil.view.scene.world import WorldScene
from hil.view.sources.source import Source
from hil.view.teleop.steering import Steering
from sim.environment.world import World
from sim.sensors.sensor_set import SensorSet
from sim.vehicle.vehicle import Vehicle as VehicleFile

PERIOD_S = 0.05  # between two updates of the scene
PANEL_EVERY = 4  # frames
TRACK_EVERY = 10  # frames
MOVED = 1e-3  # m; a camera does not follow a smaller movement
TOP_HEIGHT = 20.0  # m
JPEG, RAW, SONAR, SIDE_SCAN = (
    "camera/image_raw/compressed", "camera/image_raw", "forward_sonar/image", "side_scan/image",
)  # fmt: skip


class SceneContent(NamedTuple):
    """Data of a run from its scenario; without a scenario the fields are None or empty."""

    world: World | None = None
    vehicles: Mapping[str, VehicleFile] = {}
    path: Sequence[Sequence[float]] = ()
    depth: float = 0.0
    goal: tuple[float, float] | None = None
    sensors: SensorSet = MappingProxyType({})  # of each vehicle
    hunt: Hunt | None = None


class LiveView:
    """The view at `host`:`port`. Use as a context; call `update` about every `PERIOD_S` s. Raises NetworkError."""

    def __init__(
        self, source: Source, content: SceneContent, host: str, port: int, token: str, tls: SSLContext | None = None
    ) -> None:
        self._source, self._content = source, content
        self._scene = SceneServer()
        server = self._server = self._scene.server
        server.scene.set_up_direction("+z")
        self._panels = Panels(server, source.names, content.hunt is not None)
        self._world = WorldScene(server, content.world) if content.world else None
        if self._world:
            self._world.draw_path(content.path, content.depth)
            if content.goal:
                self._world.draw_goal(*content.goal, content.depth)
        else:
            server.scene.add_grid("/grid", 100.0, 100.0)
        self._fleet = FleetScene(server, content.hunt, self._world) if content.hunt and self._world else None
        thrusters = [thruster.name for vehicle in list(content.vehicles.values())[:1] for thruster in vehicle.thrusters]
        self._actions = ActionsPanel(server, self._panels.actions, self._vehicle, self._panels.add_log_line, thrusters)
        self._recording = RecordingPanel(server, self._panels.actions, source.recorder, self._panels.add_log_line)
        self._playback = PlaybackPanel(server, source.playback) if source.playback else None
        self._drawn: dict[str, VehicleScene] = {}
        self._plans: dict[str, Any] = {}
        self._steering: dict[str, Steering] = {}
        self._waterfalls: dict[str, pictures.Waterfall] = {}
        self._frames = 0
        self._last_place: tuple[float, ...] | None = None
        server.on_client_connect(self._place_camera)
        self._panels.camera.on_update(lambda _: self._place_cameras())
        self._page_server = PageServer(host, port, self._scene.port, self._scene.secret, token, self._on_stick, tls)
        self.port = self._page_server.port

    def __enter__(self) -> "LiveView":
        return self

    def __exit__(self, *_: object) -> None:
        self._page_server.__exit__()
        for steering in self._steering.values():
            steering.__exit__()
        self._scene.__exit__()

    @property
    def viewers(self) -> int:
        """Number of connected browsers."""
        return self._scene.viewers

    def update(self) -> None:
        """Draw the newest samples of all vehicles. Without a browser it draws only twice a second, for the tracks."""
        names = self._source.names
        self._panels.choose_from(names)
        for line in self._source.log_lines():
            self._panels.add_log_line(line)
        self._source.show(self.viewers > 0, bool(self._panels.pictures.value))
        self._frames += 1
        if not self.viewers and self._frames % TRACK_EVERY:
            return
        with self._server.atomic():
            for name in names:
                self._draw_vehicle(name)
            if self._frames % PANEL_EVERY == 0:
                self._recording.update()
                if self._fleet:
                    present = [name for name in names if self._source.is_present(name)]
                    places = {name: self._drawn[name].position for name in present if self._drawn[name].is_placed}
                    self._fleet.draw({name: self._source.latest(name) for name in present}, places)
                if self._name in names:
                    self._draw_panels(self._name)
        if self._panels.camera.value == "follow":
            self._follow()

    @property
    def _name(self) -> str:
        return str(self._panels.vehicle.value)

    def _vehicle(self) -> Vehicle | None:
        return self._source.vehicle(self._name) if self._name in self._source.names else None

    def _draw_vehicle(self, name: str) -> None:
        drawn = self._drawn.get(name)
        if drawn is None:
            vehicles = self._content.vehicles
            file = vehicles.get(name) or next(iter(vehicles.values()), None)
            drawn = self._drawn[name] = VehicleScene(self._server, name, file, self._content.sensors)
        latest = self._source.latest(name)
        drawn.move(latest)
        self._draw_plan(name, latest.get("plan"))
        if self._frames % TRACK_EVERY == 0:
            drawn.draw_tracks()
        if self._frames % PANEL_EVERY == 0:
            drawn.sensors.draw_scans(latest)
            self._draw_pictures(name, drawn.sensors, latest)

    def _draw_plan(self, name: str, plan: Any) -> None:
        """Draw the path that a vehicle's planner has published. It replaces the path from the scenario."""
        if self._world and plan and plan != self._plans.get(name):
            self._plans[name] = plan
            alone = len(self._content.vehicles) <= 1
            self._world.draw_path(plan, self._content.depth, "path" if alone else f"path/{name}")

    def _draw_pictures(self, name: str, sensors: SensorScene, latest: Mapping[str, Any]) -> None:
        is_chosen = name == self._name
        for topic, image in latest.items():
            sensor, first = topic.partition("/")[0], first_of(topic)
            title = sensor.replace("_", " ")
            if first == JPEG or (first == RAW and f"{topic}/compressed" not in latest):
                if (picture := pictures.camera_picture(image)) is not None:
                    sensors.draw_camera(picture, sensor)
                    if is_chosen:
                        self._panels.show_picture(title, picture)
            elif first == SONAR:
                altitude = latest["altitude"].distance if "altitude" in latest else 0.0
                sensors.draw_sonar(*pictures.fan_points(image, altitude, sensors.mounting(sensor)), sensor)
                if is_chosen:
                    self._panels.show_picture(f"{title}, ahead is up", pictures.fan_picture(image))
            elif first == SIDE_SCAN and is_chosen:
                waterfall = self._waterfalls.setdefault(f"{name}/{sensor}", pictures.Waterfall())
                here = latest.get("odom") or latest.get("ground_truth")
                if waterfall.add(image, here.position if here else None):
                    self._panels.show_picture(f"{title}, port left", waterfall.picture())

    def _draw_panels(self, name: str) -> None:
        figures = self._source.diagnostics(name)
        file = self._content.vehicles.get(name)
        names = [thruster.name for thruster in file.thrusters] if file else []
        now = instruments.reading(self._source.latest(name), figures.pwm_us or (), names)
        if now:
            self._panels.show_instruments(instruments.draw(now))
        self._panels.show_health(figures)
        self._panels.show_delays(*self._source.delays_ms(name))
        self._actions.show_reason(_unavailable_reason(self._source.vehicle(name), self._source.is_present(name)))
        if self._playback:
            self._playback.update()

    def _place_cameras(self) -> None:
        for client in self._server.get_clients().values():
            self._place_camera(client)

    def _place_camera(self, client: Any) -> None:
        """Move a browser's camera to the chosen vehicle, above it or beside it as chosen in the panel."""
        position = self._drawn[self._name].position if self._name in self._drawn else (0.0, 0.0, 0.0)
        if self._panels.camera.value == "top":
            client.camera.position = (position[0], position[1] - 0.01, position[2] + TOP_HEIGHT)
        else:
            client.camera.position = tuple(a + b for a, b in zip(position, CAMERA_OFFSET, strict=True))
        client.camera.look_at = tuple(position)
        self._last_place = tuple(position)

    def _follow(self) -> None:
        """Move all cameras along with the chosen vehicle, and keep the direction to which a person has turned them."""
        if self._name not in self._drawn:
            return
        position = tuple(self._drawn[self._name].position)
        if self._last_place is not None and dist(position, self._last_place) < MOVED:
            return
        self._last_place = position
        for client in self._server.get_clients().values():
            with client.atomic():
                move_camera(client.camera, position)

    def _on_stick(self, person: int, message: Mapping[str, Any] | None) -> Mapping[str, Any]:
        """Handle a message of a browser's stick; return what the bar of its page shows."""
        names = self._source.names
        if message is None:
            for steering in self._steering.values():
                steering.update(person, None)
            return {}
        name = str(message.get("vehicle") or "")
        if name not in names:
            text, may = "no vehicle yet; waiting for one", {"may_stop": False, "may_steer": False}
            return {"vehicles": names, "text": text, "dark": bool(self._panels.dark.value), **may}
        vehicle, present = self._source.vehicle(name), self._source.is_present(name)
        reason = _unavailable_reason(vehicle, present)
        text = reason
        if vehicle:
            text = self._act(vehicle, message) or reason
            if not reason:
                if name not in self._steering:
                    self._steering[name] = Steering(vehicle, self._panels.add_log_line)
                text = text or self._steering[name].update(person, dict(message))
        return {
            "vehicles": names, "text": text or "ready", "may_stop": bool(vehicle) and present,
            "may_steer": not reason, "armed": self._source.diagnostics(name).armed,
            "dark": bool(self._panels.dark.value),
        }  # fmt: skip

    def _act(self, vehicle: Vehicle, message: Mapping[str, Any]) -> str:
        """Do what the pressed buttons of the bar request; return the error, or ""."""
        wanted = message.get("acts")
        for name in wanted if isinstance(wanted, list) else ():
            try:
                if name in ("stop", "disarm"):
                    self._panels.add_log_line(f"{vehicle.name}: {services.arm(vehicle, False)}")
                elif name == "arm":
                    self._panels.add_log_line(f"{vehicle.name}: {services.arm(vehicle, True)}")
            except HilError as error:
                self._panels.add_log_line(f"{vehicle.name}: {name}: {error}")
                return f"{name}: {error}"
        return ""


def _unavailable_reason(vehicle: Vehicle | None, present: bool) -> str:
    """Return why a vehicle does not accept commands now, and the remedy; "" if no reason is known."""
    if vehicle is None:
        return "this view only observes"
    if not present:
        return f"{vehicle.name} is not connected"
    return vehicle.client.unavailable_reason()
