"""What the buttons of the page do: hold, go, fly waypoints, fail thrusters, reset, set a pose, record, pace time."""

import threading
from collections.abc import Callable, Mapping
from math import degrees, isfinite, radians
from typing import Any

from hil.client import services
from hil.client.vehicle_handle import Vehicle
from hil.common.errors import ConfigError, HilError, NetworkError
from hil.view.feed import Feed
from hil.view.sources.source import Source
from sim.vehicle.failures import VALUES

Act = Mapping[str, Any]
OBSERVES = "this view only observes"
NOTHING_TO_RECORD = "only vehicles on the network are recorded here: this is a recording, or a simulation"
MAX_WAYPOINTS = 100


class Actions:
    """The actions of one view. The outcome of each is a line of the log.

    `targets` are what each vehicle was told to reach or hold from here, `failures` the failures of its thrusters.
    """

    def __init__(self, source: Source, feed: Feed) -> None:
        self._source, self._feed = source, feed
        self.targets: dict[str, dict[str, Any]] = {}
        self.failures: dict[str, dict[str, str]] = {}
        self._of_vehicle: dict[str, Callable[[Vehicle, Act], str]] = {
            "arm": lambda vehicle, _: services.arm(vehicle, True),
            "disarm": lambda vehicle, _: services.arm(vehicle, False),
            "stop": lambda vehicle, _: services.arm(vehicle, False),
            "hold": self._hold,
            "still": lambda vehicle, _: self._command(vehicle, "stand still", {}, vehicle.stop),
            "release": lambda vehicle, _: self._command(vehicle, "no more commands are sent", {}, vehicle.release),
            "go": self._go,
            "follow": self._follow,
            "fail": self._fail,
            "reset": lambda vehicle, _: self._reset(vehicle),
            "pose": self._pose,
        }
        self._of_view: dict[str, Callable[[str, Act], str]] = {
            "take": lambda name, _: source.take_over(name, True),
            "give": lambda name, _: source.take_over(name, False),
            "record": lambda _, __: self._record(),
            "time": lambda _, act: self._pace(act),
        }

    def start(self, name: str, act: Act) -> None:
        """Do an act of the page in a thread, because it may wait for the vehicle's answer."""
        threading.Thread(target=self.run, args=(name, act), name="action", daemon=True).start()

    def run(self, name: str, act: Act) -> str:
        """Do an act of the page with the vehicle `name`; return the error, or ""."""
        what = str(act.get("do"))
        try:
            if what in self._of_view:
                text = self._of_view[what](name, act)
            elif what in self._of_vehicle:
                vehicle = self._source.vehicle(name) if name in self._source.names else None
                if vehicle is None:
                    raise NetworkError(OBSERVES)
                text = f"{name}: {self._of_vehicle[what](vehicle, act)}"
            else:
                return ""
        except HilError as error:
            self._feed.add_log_line(f"{what}: {error}", "error")
            return f"{what}: {error}"
        if text:
            self._feed.add_log_line(text)
        return ""

    def _command(self, vehicle: Vehicle, text: str, target: dict[str, Any], command: Callable[[], object]) -> str:
        command()
        self.targets[vehicle.name] = target
        return text

    def _hold(self, vehicle: Vehicle, act: Act) -> str:
        depth = _number(act, "depth") if act.get("depth") is not None else None
        heading = _wrapped(_number(act, "heading")) if act.get("heading") is not None else None
        surge = _number(act, "speed") if act.get("speed") is not None else 0.0
        text = "hold" if depth is None else f"hold depth {depth:.1f} m"
        text += "" if heading is None else f" heading {degrees(heading) % 360.0:03.0f}°"
        target = {"depth": depth, "heading": heading, "speed": surge or None}
        return self._command(vehicle, text, target, lambda: vehicle.drive(surge, depth=depth, heading=heading))

    def _go(self, vehicle: Vehicle, act: Act) -> str:
        place = _number(act, "north"), _number(act, "east"), _number(act, "depth")
        text = f"go to {place[0]:.1f} m north, {place[1]:.1f} m east, {place[2]:.1f} m deep"
        return self._command(vehicle, text, {"places": [place], "depth": place[2]}, lambda: vehicle.go_to(*place))

    def _follow(self, vehicle: Vehicle, act: Act) -> str:
        given = act.get("points")
        points = given[:MAX_WAYPOINTS] if isinstance(given, list) else []
        if not points:
            raise ConfigError("no waypoints yet: choose 'add waypoints', and click in the scene")
        if not all(isinstance(point, list) and len(point) == 3 for point in points):
            raise ConfigError("a waypoint is north, east, depth in m")
        places = [tuple(_finite(value, "waypoint") for value in point) for point in points]
        speed = _number(act, "speed")
        if speed <= 0.0:
            raise ConfigError(f"speed: {speed:g} m/s moves nothing: give one above 0")
        return self._command(
            vehicle, f"fly {len(places)} waypoints", {"places": places}, lambda: vehicle.follow(places, speed=speed)  # type: ignore[arg-type]
        )  # fmt: skip

    def _fail(self, vehicle: Vehicle, act: Act) -> str:
        thruster, kind = str(act.get("thruster")), str(act.get("kind"))
        value = _number(act, "value") if kind in VALUES and kind != "stuck" else None
        text = services.fail_thruster(vehicle, thruster, kind, value)
        self.failures.setdefault(vehicle.name, {})[thruster] = kind
        return text

    def _reset(self, vehicle: Vehicle) -> str:
        text = services.reset(vehicle)
        self.failures.pop(vehicle.name, None)
        return text

    def _pose(self, vehicle: Vehicle, act: Act) -> str:
        place = _number(act, "north"), _number(act, "east"), _number(act, "depth")
        return services.set_pose(vehicle, *place, radians(_number(act, "heading")))

    def _record(self) -> str:
        """Start or stop the recording."""
        recorder = self._source.recorder
        if recorder is None:
            raise ConfigError(NOTHING_TO_RECORD)
        return recorder.stop() if recorder.state else recorder.start()

    def _pace(self, act: Act) -> str:
        """Pause, step, speed up or seek simulated or recorded time."""
        playback = self._source.playback
        if playback is None:
            raise ConfigError("the time of vehicles on the network cannot be changed")
        playback.change(
            _number(act, "seek") if "seek" in act else None,
            act["paused"] is True if "paused" in act else None,
            min(max(_number(act, "speed"), 0.01), 1000.0) if "speed" in act else None,
        )
        if act.get("step"):
            playback.step()
        return ""


def _number(act: Act, key: str) -> float:
    return _finite(act.get(key), key)


def _finite(value: Any, name: str) -> float:
    """Return a number from the page. Raises ConfigError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise ConfigError(f"{name}: {str(value)[:40]} is no number")
    return float(value)


def _wrapped(angle: float) -> float:
    """Return degrees as radians from -pi to pi."""
    return radians((angle + 180.0) % 360.0 - 180.0)
