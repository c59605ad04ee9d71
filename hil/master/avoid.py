"""Plan with A* on the map and steer with VFH+ by scans (Zhang et al. 2022).

    [planner]
    class = "hil.master.avoid:Avoid"
    scan = "laser"

    [planner.vfh]
    safety = "0.2 m"

The scans are also entered into the map. When a new obstacle lies on the path, the rest of the path is planned again.
"""

from math import hypot
from typing import Annotated, Any, Literal, NamedTuple

from hil.autonomy.control.controller import VelocityCommand, heading_of
from hil.autonomy.paths.any_angle import plan_any_angle
from hil.autonomy.paths.astar import plan
from hil.autonomy.paths.guide import Guide, GuideSettings, Search
from hil.autonomy.paths.occupancy import OccupancyGrid, Point
from hil.autonomy.paths.vfh import Scan, VfhSettings
from hil.common.schema import Range, parse
from hil.master.follow import course_of, goal_of
from hil.master.planner import Done, Planner, PlanRequest, Samples

_NS_PER_S = 1_000_000_000
_BLIND_AFTER_NS = _NS_PER_S  # the vehicle stops if the newest scan is older
_FAR_M = 100.0  # most for the circles in which a vehicle with fins looks for obstacles
_GIVE_UP_S = 20.0  # the run ends if there is no free way for so long


class AvoidSettings(NamedTuple):
    """The planner's keys.

    `scan` is the topic of the sensor that detects obstacles; it is taken as mounted at the vehicle's centre,
    horizontally. `search` is the path search on the map. `max_yaw_rate` is in rad/s.
    """

    scan: Literal["laser", "scanning_sonar"] = "laser"
    search: Literal["astar", "any_angle"] = "astar"
    max_yaw_rate: Annotated[float, Range(0.01, 3.0, "rad/s")] = 0.5


class Sight:
    """Path planning and obstacle avoidance to one goal after another, on one map that grows with each scan."""

    def __init__(self, settings: AvoidSettings, vfh: dict[str, Any], request: PlanRequest) -> None:
        length, width = request.vehicle.dimensions[:2]
        radius, master = hypot(length, width) / 2, request.master
        self._topic = settings.scan
        self._search: Search = {"astar": plan, "any_angle": plan_any_angle}[settings.search]
        circle, shares = request.limits.turn_radius, {"range": 3.0, "free_beyond": 2.2, "block_within": 2.0}
        sees = {key: min(share * circle, _FAR_M) for key, share in {"turning_radius": 1.0, **shares}.items()}
        self._settings = GuideSettings(
            parse({"radius": radius, **(sees if circle else {}), **vfh}, VfhSettings, "[planner.vfh]"),
            speed=master.speed,
            lookahead=master.lookahead,
            max_yaw_rate=settings.max_yaw_rate,
            tolerance=master.tolerance,
            margin=master.margin,
            limits=request.limits,
        )
        self._map: OccupancyGrid = request.map
        self._depth = master.depth
        self._seen_ns = -1
        self._command = VelocityCommand()
        self.guide: Guide | None = None
        self.plans = 0

    def begin(self, start: Point, goal: Point, heading: float) -> None:
        """Plan a path from `start` and `heading` (rad) to `goal` (m north, m east).

        Raises MissionError if the map shows no path.
        """
        if self.guide:
            self._map = self.guide.map.grid
        self.guide = Guide(self._map, start, goal, self._settings, self._search, heading)
        self._command = VelocityCommand()

    def command(self, samples: Samples) -> VelocityCommand:
        """Return the command for the newest scan; a standstill if there is no recent scan."""
        odometry, scan = samples["odom"], samples.get(self._topic)
        if self.guide is None or scan is None or odometry.time_ns - scan.time_ns > _BLIND_AFTER_NS:
            return VelocityCommand(depth=self._depth)
        if scan.time_ns != self._seen_ns:
            self._seen_ns = scan.time_ns
            seen = Scan(scan.angle_min, scan.angle_increment, scan.ranges)
            course = course_of(odometry) if self._settings.limits.turn_radius else None
            heading, time = heading_of(odometry.orientation), scan.time_ns / _NS_PER_S
            self._command = self.guide.update(odometry.position, heading, seen, course, time)
        return self._command._replace(depth=self._depth)


class Avoid(Planner):
    """Planner that avoids obstacles on the path to the scenario's goal.

    `[planner.vfh]` takes the keys of hil.autonomy.paths.vfh.VfhSettings except the radius."""

    hovers = "stops in front of obstacles"

    def __init__(self, vfh: dict[str, Any] | None = None, **keys: Any) -> None:
        self._settings = parse(keys, AvoidSettings, "Avoid")
        self.subscriptions = (self._settings.scan,)
        self._vfh = vfh or {}
        self._stuck_since: float | None = None

    def begin(self, request: PlanRequest) -> None:
        """Plan the path. Raises MissionError, ConfigError."""
        self._sight = Sight(self._settings, self._vfh, request)
        self._sight.begin((request.start.north, request.start.east), goal_of(request), request.start.heading)
        self._follow()

    def command(self, time: float, samples: Samples) -> VelocityCommand | Done:
        """Return the command along the path and around obstacles: standstill, later `Done`, if there is no free way."""
        command = self._sight.command(samples)
        guide = self._follow()
        if guide.has_arrived:
            return Done("goal reached")
        self._stuck_since = (time if self._stuck_since is None else self._stuck_since) if guide.stuck else None
        if self._stuck_since is not None and time - self._stuck_since > _GIVE_UP_S:
            return Done(guide.stuck, reached=False)
        return command

    def _follow(self) -> Guide:
        guide = self._sight.guide
        assert guide is not None, "begin gave it a goal"
        self.path, self.progress = guide.path, guide.progress
        self.status = f"plan {guide.plans}" + (f", stuck: {guide.stuck}" if guide.stuck else "")
        return guide
