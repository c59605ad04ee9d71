"""Collect the health of every slave within reach: last diagnostics, rates of counters, presence."""

import threading
from collections.abc import Mapping
from typing import Any, NamedTuple

from hil.common.clock import NS_PER_S, now_ns
from hil.common.endpoint import LAN, split_endpoint
from hil.network.presence import watch_presence
from hil.network.session import Session
from hil.network.tokens import Presence
from hil.ros import dialect
from hil.ros import encoders as ros
from hil.ros.diagnostics import Diagnostics, Figure

QUEUE = 256
CHECK_PERIOD_S = 10.0
PACED: tuple[Figure[Any], ...] = (  # counters whose rates are reported
    Diagnostics.cpu_s,
    Diagnostics.commands_received,
    Diagnostics.messages_sent,
    Diagnostics.network_received_bytes,
    Diagnostics.network_sent_bytes,
)


class Status(NamedTuple):
    """Last diagnostics of one slave, and the rates of its counters (`paces`, per second, by name).

    `level`: 0 ok, 1 warning, 2 error, with its `message`. `present`: by its token. `received_ns`: monotonic ns.
    """

    node: str
    level: int
    message: str
    figures: Diagnostics
    paces: Mapping[str, float]
    received_ns: int
    present: bool

    @property
    def age_s(self) -> float:
        """Seconds since these diagnostics were received."""
        return (now_ns() - self.received_ns) / NS_PER_S

    def pace(self, counter: Figure[int] | Figure[float]) -> float | None:
        """Return the rate (per second) of one of `PACED`; for processor time this is the share of a core.

        Return None if the rate is not known.
        """
        return self.paces.get(counter.name)


class HealthWatch:
    """Receive the diagnostics of all slaves of a session, until the session ends."""

    def __init__(self, session: Session) -> None:
        self._statuses: dict[str, Status] = {}
        self._present: dict[str, set[str]] = {}
        self._lock = threading.Lock()
        self.malformed = 0
        watch_presence(session, "*", self._on_presence)
        session.supervisor.watch_presence(lambda: any(self._present.values()))
        session.subscribe_keys(f"{dialect.domain()}/*/diagnostics/*/*", self._deliver, QUEUE)

    def statuses(self) -> list[Status]:
        """Return the status of every slave that has sent diagnostics, by name."""
        with self._lock:
            present = {name: bool(self._present.get(name)) for name in self._statuses}
            return sorted([status._replace(present=present[name]) for name, status in self._statuses.items()])

    def without_answer(self) -> list[str]:
        """Return the slaves that are present but have sent no diagnostics yet."""
        with self._lock:
            return sorted(name for name, there in self._present.items() if there and name not in self._statuses)

    def mixed(self) -> dict[str, int]:
        """Return the names that several slaves share, with their number; the diagnostics of such slaves are mixed."""
        with self._lock:
            return {name: len(there) for name, there in sorted(self._present.items()) if len(there) > 1}

    def _on_presence(self, presence: Presence, alive: bool) -> None:
        if presence.role == "slave":
            with self._lock:
                there = self._present.setdefault(presence.node, set())
                (there.add if alive else there.discard)(presence.ident)

    def _deliver(self, key: str, payload: bytes, _attachment: bytes) -> None:
        received_ns = now_ns()
        figures = ros.decode_diagnostics(payload)
        node = key.split("/")[1]
        if not figures:
            self.malformed += 1
            return
        level, message, values = figures[0][1], figures[0][2], Diagnostics(figures[0][3])
        with self._lock:
            paces = _paces(self._statuses.get(node), values, received_ns)
            self._statuses[node] = Status(node, level, message, values, paces, received_ns, True)


class Unanswered:
    """Find the `endpoints` that do not answer, in a thread, while a slave may be missing.

    `folder` has our certificates ("" without TLS); `routed`: the endpoint is a router's. `lines` has one line for each
    such endpoint, with the reason. The thread ends with the session.
    """

    def __init__(
        self, session: Session, watch: HealthWatch, endpoints: list[str], folder: str = "", routed: bool = False
    ) -> None:
        self._session, self._watch = session, watch
        self._endpoints, self._folder, self._routed = endpoints, folder, routed
        self.lines: list[str] = []
        session.every(CHECK_PERIOD_S, self.check_endpoints, "endpoints")

    def check_endpoints(self) -> None:
        """Check all endpoints now; takes up to some seconds each."""
        from hil.network.diagnosis import why_not  # needed only if a slave is missing

        there = sum(status.present for status in self._watch.statuses()) + len(self._watch.without_answer())
        missing = self._endpoints if there < len(self._endpoints) else []
        unreached = [endpoint for endpoint in missing if not self._reached(endpoint)]
        faults = [(endpoint, why_not(endpoint, self._folder, self._routed)) for endpoint in unreached]
        self.lines = [f"nobody at {endpoint}: {fault.text}" for endpoint, fault in faults if fault]

    def _reached(self, endpoint: str) -> bool:
        """Return whether a link leads to the endpoint, as far as its port tells; links do not carry host names."""
        if endpoint == LAN:
            return bool(self._session.links())
        ports = [split_endpoint(one)[2] for one in self._endpoints if one != LAN]
        port = split_endpoint(endpoint)[2]
        from hil.network.diagnosis import has_connected

        return ports.count(port) == 1 and has_connected(self._session, port)


def _paces(before: Status | None, figures: Diagnostics, received_ns: int) -> dict[str, float]:
    """Return the rates of counters since `before`; empty after a restart of the slave, which resets the counters."""
    if before is None or before.figures.exec_wall_ns != figures.exec_wall_ns:
        return {}
    seconds = max((received_ns - before.received_ns) / NS_PER_S, 1e-3)
    if seconds < 0.2:  # too short for a rate
        return dict(before.paces)
    paces = {}
    for counter in PACED:
        now, then = counter.read(figures), counter.read(before.figures)
        if now is not None and then is not None:
            paces[counter.name] = (now - then) / seconds
    return paces
