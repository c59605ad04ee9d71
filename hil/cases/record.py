"""The record of one run of a case: its results, a row of the table, and its tracks."""

import csv
import os
from collections.abc import Mapping, Sequence
from math import nan
from types import MappingProxyType
from typing import Literal, NamedTuple

from hil.autonomy.paths.occupancy import Point

Mode = Literal["sil", "hil"]


class Result(NamedTuple):
    """Results of one flight in s, m, J, shares of one core, ms. nan: not measured or not applicable.

    - `success`: the case's criterion is met, and there were no `events` that the scenario does not allow.
    - `path_length`: travelled, by all vehicles together.
    - `optimum`: length of the shortest path that the vehicle's size allows (no margin); `ratio`: path length over it.
    - `least_clearance`: from the centre of the vehicle to the nearest obstacle.
    - `collided`: a vehicle touched an obstacle, or came nearer than its radius.
    - `energy`: see hil/cases/energy.py.
    - `cross_track_rms`, `cross_track_max`: distances from the path that was followed.
    - `master_cpu`: of the planner's whole process during the flight, with all vehicles; `planner_cpu`: of the planner.
    - `delay_p50`, `delay_p99`: of commands, from publishing to applied pulses.
    - `events`: those of sim/run_events.py, as text.
    - `extra`: results that only this case has.
    """

    case: str
    mode: Mode
    seed: int
    success: bool
    reason: str
    duration: float
    path_length: float
    optimum: float
    ratio: float
    least_clearance: float
    collided: bool
    energy: float
    cross_track_rms: float
    cross_track_max: float
    goal_error: float
    master_cpu: float = nan
    planner_cpu: float = nan
    delay_p50: float = nan
    delay_p99: float = nan
    events: tuple[str, ...] = ()
    extra: Mapping[str, float] = MappingProxyType({})


class Track(NamedTuple):
    """True track of one vehicle, and the first path of its planner, `plan` (m north, m east).

    `time`: s. `north`, `east`: m. `surge`, `commanded_surge`: m/s.
    """

    name: str
    time: Sequence[float]
    north: Sequence[float]
    east: Sequence[float]
    surge: Sequence[float]
    commanded_surge: Sequence[float]
    plan: Sequence[Point] = ()

    @property
    def points(self) -> list[Point]:
        """North and east (m) of its points, in order of time."""
        return list(zip(self.north, self.east, strict=True))


class Run(NamedTuple):
    """A flight: its result, a track for each vehicle, and the path of its scenario."""

    result: Result
    tracks: tuple[Track, ...]
    scenario: str


def read_track(folder: str, name: str, plan: Sequence[Point] = ()) -> Track:
    """Return the track that `hil.master.recorder.TrackWriter` wrote to `folder`."""
    with open(os.path.join(folder, "track.csv"), newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    columns = ("time_s", "true_north_m", "true_east_m", "surge_m_s", "commanded_surge_m_s")
    time, north, east, surge, commanded = ([float(row[column]) for row in rows] for column in columns)
    return Track(name, time, north, east, surge, commanded, tuple(plan))
