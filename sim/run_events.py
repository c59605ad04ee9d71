"""Detect what went wrong in a run: collisions, a capsize, an unrequested depth, a lost link.

An event is one uninterrupted stretch of one condition: its kind, when it began, how long it held, where the vehicle was
when it began, and what it touched. Nothing here reads a clock: each observation comes with its time (ns), by a clock
that the observer chooses.

collision   the hull touched an obstacle or the seabed; `what` names it
capsize     the body's z axis is tilted from the vertical by more than the vehicle's `capsize_tilt`
surfaced    the origin is nearer to the mean surface than half the hull's height, though no depth so shallow was asked
too_deep    the origin is deeper than the deepest depth that was asked for, by more than a margin
link_lost   the thruster link or its STM32 is lost, or the network to the vehicle
"""

from collections.abc import Iterable, Sequence
from math import cos, inf, pi
from typing import Literal, NamedTuple, get_args

EventKind = Literal["collision", "capsize", "surfaced", "too_deep", "link_lost"]
KINDS: tuple[EventKind, ...] = get_args(EventKind)

JOIN_NS = 1_000_000_000  # a condition that returns within this time has not ended: a hull slides in small bounces
PERIOD_NS = 50_000_000  # between two checks of attitude and depth; a vehicle needs longer to tip over
MOST_EVENTS = 32  # that a log holds; the rest is counted
DEPTH_MARGIN_M = 1.0


class RunEvent(NamedTuple):
    """One stretch of one condition. `start_ns` and `duration_ns` by the clock of its log, `place` NED in m."""

    kind: EventKind
    start_ns: int
    duration_ns: int
    place: tuple[float, float, float]
    what: str = ""

    @property
    def end_ns(self) -> int:
        """Time (ns) at which the condition last held."""
        return self.start_ns + self.duration_ns

    @property
    def name(self) -> str:
        """The event in a few words."""
        name = self.kind.replace("_", " ")
        if not self.what:
            return name
        return f"{name} with {self.what}" if self.kind == "collision" else f"{name}: {self.what}"

    def describe(self) -> str:
        """Return what happened, when, for how long and where, in words; times in s of its clock."""
        duration = self.duration_ns * 1e-9
        lasted = f"for {duration:.1f} s" if duration >= 0.1 else "for less than 0.1 s"
        return f"{self.name} {self.start_ns * 1e-9:.1f} s after the start, {lasted}, at {place_text(self.place)}"


def place_text(place: Sequence[float]) -> str:
    """Return a place (NED, m) in words."""
    return "N {:.1f} E {:.1f} depth {:.1f} m".format(*place)


class EventLog:
    """The events so far. `dropped` counts those beyond MOST_EVENTS."""

    def __init__(self) -> None:
        self._events: list[RunEvent] = []
        self._newest: dict[tuple[EventKind, str], int] = {}
        self._returned = 0  # how many `fresh` has given
        self.dropped = 0

    def __len__(self) -> int:
        return len(self._events)

    def hold(self, kind: EventKind, since_ns: int, until_ns: int, place: Sequence[float], what: str = "") -> None:
        """Record that a condition held from `since_ns` to `until_ns`, with the vehicle at `place` (NED, m)."""
        newest = self._newest.get((kind, what))
        if newest is not None:
            event = self._events[newest]
            if since_ns - event.end_ns <= JOIN_NS:
                self._events[newest] = event._replace(duration_ns=max(until_ns, event.end_ns) - event.start_ns)
                return
        if len(self._events) >= MOST_EVENTS:
            self.dropped += 1
            return
        self._newest[kind, what] = len(self._events)
        north, east, depth = place
        self._events.append(RunEvent(kind, since_ns, until_ns - since_ns, (north, east, depth), what))

    def fresh(self) -> list[RunEvent]:
        """Return the events that have been added since the last call."""
        events, self._returned = self._events[self._returned :], len(self._events)
        return events

    def events(self) -> tuple[RunEvent, ...]:
        """Return all events, in the order in which they were first recorded."""
        return tuple(self._events)


class RunMonitor:
    """Checks attitude and depth of a vehicle, and records capsizes and wrong depths in `log`.

    `capsize_tilt` is in rad; from pi on a vehicle never counts as capsized. `half_height` is half the height of its
    hull (m), `margin` how far it may be below the deepest depth that was asked for (m). The depths asked for are that
    of the first observation and those given with each observation. The vehicle may be anywhere between the shallowest
    and the deepest of them at any time: how soon it gets from one to another is not checked.
    """

    def __init__(self, log: EventLog, capsize_tilt: float, half_height: float, margin: float = DEPTH_MARGIN_M) -> None:
        self.log = log
        self._shallowest, self._deepest = inf, -inf  # that were asked for
        self._least_upright = cos(capsize_tilt) if capsize_tilt < pi else -inf  # never
        self._half_height = half_height
        self._margin = margin

    def observe(
        self, time_ns: int, position: Sequence[float], quaternion: Sequence[float], requested_depth: float | None = None
    ) -> None:
        """Check the vehicle at `position` (NED, m) and attitude (w x y z, body to world), commanded to `requested` m.

        `requested` is None where no depth is commanded: then any depth is right.
        """
        depth = position[2]
        if requested_depth is None or self._deepest == -inf:
            self._start_depth(depth)
        if requested_depth is not None:
            self._start_depth(requested_depth)
        _, x, y, _ = quaternion
        if 1.0 - 2.0 * (x * x + y * y) < self._least_upright:
            self.log.hold("capsize", time_ns, time_ns, position)
        if depth < self._half_height < self._shallowest:
            self.log.hold("surfaced", time_ns, time_ns, position)
        elif depth > self._deepest + self._margin:
            self.log.hold("too_deep", time_ns, time_ns, position)

    def _start_depth(self, depth: float) -> None:
        self._shallowest, self._deepest = min(self._shallowest, depth), max(self._deepest, depth)


def merge_events(*logs: Iterable[RunEvent]) -> tuple[RunEvent, ...]:
    """Return the events of several observers in order of time.

    Of two events of one kind and time, that of the first observer is returned.
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
    """Return the events that had not ended at `began_ns`, with times from then on."""
    shifted = [event._replace(start_ns=event.start_ns - began_ns) for event in events]
    return tuple(
        [
            event._replace(start_ns=max(event.start_ns, 0), duration_ns=event.end_ns - max(event.start_ns, 0))
            for event in shifted
            if event.end_ns >= 0
        ]
    )


def encode_events(events: Iterable[RunEvent]) -> str:
    """Return events as text, a line each: kind, start and duration (ns), place (m), and what."""
    return "\n".join([_encode(event) for event in events])


def _encode(event: RunEvent) -> str:
    north, east, depth = event.place
    what = " ".join(event.what.split())
    return f"{event.kind} {event.start_ns} {event.duration_ns} {north:.3f} {east:.3f} {depth:.3f} {what}".rstrip()


def decode_events(text: str) -> tuple[RunEvent, ...]:
    """Return what `encode_events` made; lines that are no events are left out."""
    events = []
    for line in text.splitlines():
        words = line.split(" ", 6)
        try:
            start, duration, *place = int(words[1]), int(words[2]), *map(float, words[3:6])
            north, east, depth = place
        except (ValueError, IndexError):
            continue
        if words[0] in KINDS and duration >= 0 and abs(north) + abs(east) + abs(depth) < inf:
            what = words[6] if len(words) > 6 else ""
            events.append(RunEvent(words[0], start, duration, (north, east, depth), what))
    return tuple(events)
