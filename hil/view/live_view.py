"""The live view: samples of some vehicles for the page, about 20 times a second, and the acts of the page."""

from collections.abc import Mapping
from math import dist
from ssl import SSLContext
from typing import Any

from hil.client.vehicle_handle import Vehicle
from hil.common.vectors import Vector3
from hil.ros.topics import first_of
from hil.view.feed import Encoded, Feed
from hil.view.page_server import PageServer
from hil.view.panels import pictures, readings
from hil.view.panels.actions import OBSERVES, Actions
from hil.view.scene.content import SceneContent, encode_content, with_depth
from hil.view.sources.source import Source
from hil.view.teleop.steering import Steering

PERIOD_S = 0.05  # between two updates of the scene
PANEL_EVERY = 4  # frames
TRACK_EVERY = 10  # frames without a browser
JPEG, RAW, SONAR, SIDE_SCAN = (
    "camera/image_raw/compressed", "camera/image_raw", "forward_sonar/image", "side_scan/image",
)  # fmt: skip
TRACK_STEP, MAX_POINTS = 0.1, 4000  # m between two points of a track; beyond so many every second is removed
WAITING = "no vehicle yet; waiting for one"


class LiveView:
    """The view at `host`:`port`. Use as a context; call `update` about every `PERIOD_S` s. Raises NetworkError."""

    def __init__(
        self, source: Source, content: SceneContent, host: str, port: int, token: str, tls: SSLContext | None = None
    ) -> None:
        self._source, self._content = source, content
        self._feed = Feed(self._begin)
        self._actions = Actions(source, self._feed)
        self._tracks: dict[str, tuple[list[Vector3], list[Vector3]]] = {}
        self._steering: dict[str, Steering] = {}
        self._waterfalls: dict[str, pictures.Waterfall] = {}
        self._shown_pictures: dict[str, Any] = {}
        self._frames = 0
        self._page_server = PageServer(host, port, token, encode_content(content), self._feed, self._on_stick, tls)
        self.port = self._page_server.port

    def __enter__(self) -> "LiveView":
        return self

    def __exit__(self, *_: object) -> None:
        self._page_server.__exit__()
        for steering in self._steering.values():
            steering.close()

    def update(self) -> None:
        """Pass on the newest samples of all vehicles. Without a browser only twice a second, for the tracks."""
        names, viewers = self._source.names, self._page_server.viewers
        for line in self._source.log_lines():
            self._feed.add_log_line(line, "warning" if "lost" in line else "info")
        self._source.show(bool(viewers), any(viewer.pictures for viewer in viewers))
        self._frames += 1
        if not viewers and self._frames % TRACK_EVERY:
            return
        is_panel = self._frames % PANEL_EVERY == 0
        latest = {name: self._source.latest(name) for name in names}
        moving = {name: readings.motion(newest) for name, newest in latest.items()}
        self._add_to_tracks(moving)
        self._feed.set("motion", moving)
        if viewers and is_panel:
            chosen = {viewer.vehicle for viewer in viewers}
            for name in names:
                self._show_vehicle(name, latest[name], name in chosen)
            self._show_run(latest)
        self._page_server.wake()

    def _add_to_tracks(self, moving: Mapping[str, Any]) -> None:
        for name, now in moving.items():
            if now:
                track, navigation = self._tracks.setdefault(name, ([], []))
                extend_track(track, now["position"])
                extend_track(navigation, now["navigation"])

    def _begin(self) -> Mapping[str, Any]:
        """Return the tracks so far, true and by navigation; the page continues them."""
        return {f"track/{name}": [list(each) for each in tracks] for name, tracks in self._tracks.items()}

    def _show_vehicle(self, name: str, latest: Mapping[str, Any], is_chosen: bool) -> None:
        """Pass on what is shown of a vehicle; panels and pictures only of those that a browser has chosen."""
        self._feed.set(f"scans/{name}", readings.scans(latest))
        self._feed.set(f"tether/{name}", latest.get("tether") or ())
        if plan := latest.get("plan"):
            self._feed.set(f"plan/{name}", with_depth(plan, self._content.depth))
        if is_chosen:
            figures = self._source.diagnostics(name)
            self._feed.set(f"figures/{name}", figures.raw)
            values = readings.panel(latest, figures, self._source.delays_ms(name))
            values |= {"target": self._actions.targets.get(name, {}), "failures": self._actions.failures.get(name, {})}
            self._feed.set(f"panel/{name}", values | {"present": self._source.is_present(name)})
            self._show_pictures(name, latest)

    def _show_run(self, latest: Mapping[str, Mapping[str, Any]]) -> None:
        """Pass on what is of no single vehicle: recording, time, and the places of a hunt."""
        recorder, playback, hunt = self._source.recorder, self._source.playback, self._content.hunt
        self._feed.set("recording", {"possible": recorder is not None, "state": recorder.state if recorder else ""})
        if playback:
            clock = {"time": playback.time, "paused": playback.paused, "speed": playback.speed}
            self._feed.set("playback", clock | {"duration": playback.duration})
        if hunt:
            clocks = {
                number: latest[node]["formation"].clock_ns * 1e-9
                for number, node in enumerate(hunt.nodes)
                if "formation" in latest.get(node, {})
            }
            wanted = [(*hunt.plan.position_at(number, clock), hunt.depth) for number, clock in clocks.items()]
            self._feed.set("hunt", wanted)

    def _show_pictures(self, name: str, latest: Mapping[str, Any]) -> None:
        names = []
        for topic, image in latest.items():
            sensor, first = topic.partition("/")[0], first_of(topic)
            if first == RAW and f"{topic}/compressed" in latest:
                continue
            if first in (JPEG, RAW, SONAR, SIDE_SCAN):
                names.append(sensor)
                key = f"{name}/{sensor}"
                if self._shown_pictures.get(key) is not image and (picture := self._encode(key, first, image, latest)):
                    header = {"vehicle": name, "sensor": sensor}
                    self._feed.set_picture(key, picture._replace(header=picture.header | header))
                self._shown_pictures[key] = image
        self._feed.set(f"pictures/{name}", sorted(names))

    def _encode(self, key: str, first: str, image: Any, latest: Mapping[str, Any]) -> Encoded | None:
        if first == SONAR:
            return pictures.sonar_picture(image)
        if first == SIDE_SCAN:
            waterfall = self._waterfalls.setdefault(key, pictures.Waterfall())
            here = latest.get("odom") or latest.get("ground_truth")
            if not waterfall.add(image, here.position if here else None):
                return None
            return pictures.side_scan_picture(waterfall, image)
        return pictures.camera_picture(image)

    def _on_stick(self, person: int, message: Mapping[str, Any] | None) -> Mapping[str, Any]:
        """Handle a message of a browser's stick; return what the bar of its page shows."""
        if message is None:
            for steering in self._steering.values():
                steering.update(person, None)
            return {}
        names, name = self._source.names, str(message.get("vehicle") or "")
        given = message.get("acts")
        acts = [act for act in given if isinstance(act, dict)] if isinstance(given, list) else []
        if name not in names:
            return {"vehicles": names, "text": WAITING, "may_stop": False, "may_steer": False, "may_take": False}
        for act in acts:
            self._actions.start(name, act)
        vehicle, present = self._source.vehicle(name), self._source.is_present(name)
        reason = _unavailable_reason(vehicle, present)
        text = reason
        if vehicle and not reason:
            text = self._steer(vehicle, person, message)
        taken = name in self._source.taken
        return {
            "vehicles": names, "text": text or "ready", "may_stop": bool(vehicle) and present,
            "may_steer": not reason, "armed": self._source.diagnostics(name).armed, "taken": taken,
            "may_take": bool(vehicle and present and not taken and vehicle.client.refusal()),
        }  # fmt: skip

    def _steer(self, vehicle: Vehicle, person: int, message: Mapping[str, Any]) -> str:
        """Pass a stick to the vehicle; return why this person does not steer, or ""."""
        steering = self._steering.get(vehicle.name)
        if steering is None or steering.vehicle is not vehicle:
            if steering:
                steering.close()
            steering = self._steering[vehicle.name] = Steering(vehicle, self._feed.add_log_line)
        if message.get("held") is True:
            self._actions.targets.pop(vehicle.name, None)
        return steering.update(person, dict(message))


def extend_track(track: list[Vector3], place: Vector3 | None) -> None:
    """Add a position (NED, m), unless it is within TRACK_STEP of the last; the page does the same."""
    if place and (not track or dist(place, track[-1]) >= TRACK_STEP):
        track.append(place)
    if len(track) > MAX_POINTS:
        del track[1::2]


def _unavailable_reason(vehicle: Vehicle | None, present: bool) -> str:
    """Return why a vehicle does not accept commands now, and the remedy; "" if no reason is known."""
    if vehicle is None:
        return OBSERVES
    if not present:
        return f"{vehicle.name} is not connected"
    return vehicle.client.unavailable_reason()
