"""The record of one run of a case: a row of the table, and the tracks."""

import csv
import os
from collections.abc import Mapping, Sequence
from math import nan
from types import MappingProxyType
from typing import Literal, NamedTuple

from hil.autonomy.paths.occupancy import Point

Mode = Literal["sil", "hil"]


class Result(NamedTuple):
    """One flight in numbers: s, m, J, shares of one core, ms. What was not measured or does not apply is nan.

    `success` is the case's own criterion, and that no vehicle had an event of sim/run_events.py but what its scenario
    allows; `events` are what did, in words. `path_length` is what was travelled, of all vehicles together, `optimum`
    the shortest way that the vehicle's size allows (no margin), `ratio` the first over the second. `least_clearance` is
    from the middle of the vehicle to the nearest obstacle; a vehicle that touched one, or came nearer than its radius,
    has `collided`. `energy` is what the thrusters took (hil/cases/energy.py). `cross_track_*` is from the path that was
    being followed. `master_cpu` is the processor time of the planner's whole process while it flew, all its vehicles,
    and `planner_cpu` that of the planner alone. Delays are those of commands, from publishing to applied pulses.
    `extra` are figures of that case alone.
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
    """True track of one vehicle, and the path that its planner first followed (m north, m east)."""

    name: str
    time: Sequence[float]
    north: Sequence[float]
    east: Sequence[float]
    surge: Sequence[float]
    commanded_surge: Sequence[float]
    plan: Sequence[Point] = ()

    @property
    def points(self) -> list[Point]:
        """Its places, one after the other."""
        return list(zip(self.north, self.east, strict=True))


class Run(NamedTuple):
    """A flight: its figures, a track for each vehicle, the scenario it was flown from."""

    result: Result
    tracks: tuple[Track, ...]
    scenario: str


def read_track(folder: str, name: str, plan: Sequence[Point] = ()) -> Track:
    """Return the track that `hil.master.recorder.TrackWriter` wrote into `folder`."""
    with open(os.path.join(folder, "track.csv"), newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    columns = ("time_s", "true_north_m", "true_east_m", "surge_m_s", "commanded_surge_m_s")
    time, north, east, surge, commanded = ([float(row[column]) for row in rows] for column in columns)
    return Track(name, time, north, east, surge, commanded, tuple(plan))
