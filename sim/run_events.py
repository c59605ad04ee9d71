"""Detect what went wrong in a run: collisions, a capsize, a depth that was not commanded, a lost link.

An event is one period in which a condition held without interruption: its kind, when it began, how long it lasted,
where the vehicle was when it began, and what it touched. No function here reads a clock: the caller gives the time (ns)
of each observation, by a clock of its choice.

collision   the hull touched an obstacle or the seabed; `what` names it
capsize     the body's z axis is tilted from the vertical by more than the vehicle's `capsize_tilt`
surfaced    the origin is less than half the hull's height below the mean surface, and no such depth was commanded
too_deep    the origin is deeper than the deepest commanded depth, by more than a margin
link_lost   the thruster link or its STM32 is lost, or the network to the vehicle
"""

from collections.abc import Iterable, Sequence
from math import cos, inf, pi
from typing import Literal, NamedTuple, get_args

EventKind = Literal["collision", "capsize", "surfaced", "too_deep", "link_lost"]
KINDS: tuple[EventKind, ...] = get_args(EventKind)

# Two periods of one condition less than this apart are one event: a hull that slides along a wall bounces.
JOIN_NS = 1_000_000_000
PERIOD_NS = 50_000_000  # between two checks of attitude and depth; a vehicle needs longer to tip over
MAX_EVENTS = 32  # in a log; further events are only counted
DEPTH_MARGIN_M = 1.0


class RunEvent(NamedTuple):
    """One period of one condition. `start_ns` and `duration_ns` by the clock of its log, `position` NED in m."""

    kind: EventKind
    start_ns: int
    duration_ns: int
    position: tuple[float, float, float]
    what: str = ""

    @property
    def end_ns(self) -> int:
        """Time (ns) at which the condition last held."""
        return self.start_ns + self.duration_ns

    @property
    def name(self) -> str:
        """Short text for a person, such as "collision with the pile"."""
        name = self.kind.replace("_", " ")
        if not self.what:
            return name
        return f"{name} with {self.what}" if self.kind == "collision" else f"{name}: {self.what}"

    def describe(self) -> str:
        """Return what happened, when, for how long and where, in words; times in s of its clock."""
        duration = self.duration_ns * 1e-9
        lasted = f"for {duration:.1f} s" if duration >= 0.1 else "for less than 0.1 s"
        return f"{self.name} {self.start_ns * 1e-9:.1f} s after the start, {lasted}, at {position_text(self.position)}"


def position_text(position: Sequence[float]) -> str:
    """Return a position (NED, m) as text."""
    return "N {:.1f} E {:.1f} depth {:.1f} m".format(*position)


class EventLog:
    """The events so far. `dropped` counts those beyond MAX_EVENTS."""

    def __init__(self) -> None:
        self._events: list[RunEvent] = []
        self._newest: dict[tuple[EventKind, str], int] = {}
        self._returned = 0  # number of events that `new_events` has returned
        self.dropped = 0

    def __len__(self) -> int:
        return len(self._events)

    def record(self, kind: EventKind, since_ns: int, until_ns: int, position: Sequence[float], name: str = "") -> None:
        """Record that a condition held from `since_ns` to `until_ns`, with the vehicle at `position` (NED, m)."""
        newest = self._newest.get((kind, name))
        if newest is not None:
            event = self._events[newest]
            if since_ns - event.end_ns <= JOIN_NS:
                self._events[newest] = event._replace(duration_ns=max(until_ns, event.end_ns) - event.start_ns)
                return
        if len(self._events) >= MAX_EVENTS:
            self.dropped += 1
            return
        self._newest[kind, name] = len(self._events)
        north, east, depth = position
        self._events.append(RunEvent(kind, since_ns, until_ns - since_ns, (north, east, depth), name))

    def new_events(self) -> list[RunEvent]:
        """Return the events that have been added since the last call."""
        events, self._returned = self._events[self._returned :], len(self._events)
        return events

    def events(self) -> tuple[RunEvent, ...]:
        """Return all events, in the order in which they were first recorded."""
        return tuple(self._events)


class RunMonitor:
    """Checks attitude and depth of a vehicle, and records capsizes and wrong depths in `log`.

    `capsize_tilt` is in rad; with pi or more a vehicle never counts as capsized. `half_height` is half the height of
    its hull (m), `margin` how far it may be below the deepest commanded depth (m). Commanded depths are those given
    with the observations; the depth of the first observation counts as one. The vehicle may be anywhere between the
    shallowest and the deepest of them at any time: how fast it changes depth is not checked.
    """

    def __init__(self, log: EventLog, capsize_tilt: float, half_height: float, margin: float = DEPTH_MARGIN_M) -> None:
        self.log = log
        self._shallowest, self._deepest = inf, -inf  # of the commanded depths
        self._least_upright = cos(capsize_tilt) if capsize_tilt < pi else -inf
        self._half_height = half_height
        self._margin = margin

    def observe(
        self, time_ns: int, position: Sequence[float], quaternion: Sequence[float], requested_depth: float | None = None
    ) -> None:
        """Check the vehicle at `position` (NED, m) and attitude `quaternion` (w x y z, body to world).

        `requested_depth` is the commanded depth in m, or None where no depth is commanded: then any depth is right.
        """
        depth = position[2]
        if requested_depth is None or self._deepest == -inf:
            self._allow_depth(depth)
        if requested_depth is not None:
            self._allow_depth(requested_depth)
        _, x, y, _ = quaternion
        if 1.0 - 2.0 * (x * x + y * y) < self._least_upright:
            self.log.record("capsize", time_ns, time_ns, position)
        if depth < self._half_height < self._shallowest:
            self.log.record("surfaced", time_ns, time_ns, position)
        elif depth > self._deepest + self._margin:
            self.log.record("too_deep", time_ns, time_ns, position)

    def _allow_depth(self, depth: float) -> None:
        self._shallowest, self._deepest = min(self._shallowest, depth), max(self._deepest, depth)


def merge_events(*logs: Iterable[RunEvent]) -> tuple[RunEvent, ...]:
    """Return the events of several observers in order of time.

    If two observers report an event of the same kind at the same time, the event of the first one is returned.
    """
    merged: list[RunEvent] = []
    for log in logs:
        known = list(merged)
        merged += [event for event in log if not any(_is_same(event, other) for other in known)]
    return tuple(sorted(merged, key=lambda event: event.start_ns))


def _is_same(event: RunEvent, other: RunEvent) -> bool:
    apart = max(event.start_ns - other.end_ns, other.start_ns - event.end_ns)
    return event.kind == other.kind and apart <= JOIN_NS


def events_since(events: Iterable[RunEvent], began_ns: int) -> tuple[RunEvent, ...]:
    """Return the events that had not ended at `began_ns`, with times relative to it and without the time before it."""
    shifted = [event._replace(start_ns=event.start_ns - began_ns) for event in events]
    return tuple(
        [
            event._replace(start_ns=max(event.start_ns, 0), duration_ns=event.end_ns - max(event.start_ns, 0))
            for event in shifted
            if event.end_ns >= 0
        ]
    )


def encode_events(events: Iterable[RunEvent]) -> str:
    """Return events as text, a line each: kind, start and duration (ns), position (m), and what."""
    return "\n".join([_encode(event) for event in events])


def _encode(event: RunEvent) -> str:
    north, east, depth = event.position
    what = " ".join(event.what.split())
    return f"{event.kind} {event.start_ns} {event.duration_ns} {north:.3f} {east:.3f} {depth:.3f} {what}".rstrip()


def decode_events(text: str) -> tuple[RunEvent, ...]:
    """Return the events of a text of `encode_events`; lines that are no events are left out."""
    events = []
    for line in text.splitlines():
        fields = line.split(" ", 6)
        try:
            start, duration, *position = int(fields[1]), int(fields[2]), *map(float, fields[3:6])
            north, east, depth = position
        except (ValueError, IndexError):
            continue
        if fields[0] in KINDS and duration >= 0 and abs(north) + abs(east) + abs(depth) < inf:
            what = fields[6] if len(fields) > 6 else ""
            events.append(RunEvent(fields[0], start, duration, (north, east, depth), what))
    return tuple(events)
