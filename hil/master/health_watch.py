"""The health of every slave within reach: what each last said, how fast its counters run, whether it is there."""

import threading
from collections.abc import Mapping
from typing import NamedTuple

from hil.clock import NS_PER_S, now_ns
from hil.transport import ros
from hil.transport.presence import watch_presence
from hil.transport.session import Session
from hil.transport.settings import split
from hil.transport.tokens import Presence

QUEUE = 256
ASK_PERIOD_S = 10.0
# Counters of the diagnostics whose pace is told: name of the pace -> the counter.
PACES = {
    "cpu": "cpu_s",  # share of a core
    "commands_hz": "commands_received",
    "messages_hz": "messages_sent",
    "network_received_bytes_s": "network_received_bytes",
    "network_sent_bytes_s": "network_sent_bytes",
}


class Status(NamedTuple):
    """What one slave last said of itself (`values`, see hil/slave/health.py), and at what pace (`paces`, per second).

    `level` 0 ok, 1 warning, 2 error, with the `message`; `present`: by its token; `received_ns` when it came here.
    """

    node: str
    level: int
    message: str
    values: Mapping[str, str]
    paces: Mapping[str, float]
    received_ns: int
    present: bool

    @property
    def age_s(self) -> float:
        """Seconds since it said that."""
        return (now_ns() - self.received_ns) / NS_PER_S

    def number(self, name: str) -> float | None:
        """A figure or a pace as a number; None if it is none."""
        if name in self.paces:
            return self.paces[name]
        try:
            return float(self.values.get(name, ""))
        except ValueError:
            return None


class HealthWatch:
    """Listens to the diagnostics of all slaves of a session. It ends with the session."""

    def __init__(self, session: Session) -> None:
        self._statuses: dict[str, Status] = {}
        self._present: dict[str, set[str]] = {}
        self._lock = threading.Lock()
        self.malformed = 0
        watch_presence(session, "*", self._meet)
        session.overhear("0/*/diagnostics/*/*", self._deliver, QUEUE)

    def statuses(self) -> list[Status]:
        """Of all that were ever heard, by name."""
        with self._lock:
            found = [status._replace(present=bool(self._present.get(name))) for name, status in self._statuses.items()]
        return sorted(found)

    def silent(self) -> list[str]:
        """Slaves that are there but have said nothing yet."""
        with self._lock:
            return sorted(name for name, there in self._present.items() if there and name not in self._statuses)

    def mixed(self) -> dict[str, int]:
        """Names that several slaves have, whose figures nobody can tell apart, and how many have each."""
        with self._lock:
            return {name: len(there) for name, there in sorted(self._present.items()) if len(there) > 1}

    def _meet(self, presence: Presence, alive: bool) -> None:
        if presence.part == "slave":
            with self._lock:
                there = self._present.setdefault(presence.node, set())
                (there.add if alive else there.discard)(presence.ident)

    def _deliver(self, key: str, payload: bytes, _attachment: bytes) -> None:
        received_ns = now_ns()
        said = ros.decode_diagnostics(payload)
        node = key.split("/")[1]
        if not said:
            self.malformed += 1
            return
        _, level, message, values = said[0]
        with self._lock:
            paces = _paces(self._statuses.get(node), values, received_ns)
            self._statuses[node] = Status(node, level, message, values, paces, received_ns, True)


class Unanswered:
    """Which of the `endpoints` that a session dials nobody answers at: asked in a thread while a slave may be missing.

    `folder` has our certificates ("": none); `lines` are one each, with what stands in the way. It ends with the
    session.
    """

    def __init__(self, session: Session, watch: HealthWatch, endpoints: list[str], folder: str = "") -> None:
        self._session, self._watch = session, watch
        self._endpoints, self._folder = endpoints, folder
        self.lines: list[str] = []
        session.every(ASK_PERIOD_S, self.ask, "endpoints")

    def ask(self) -> None:
        """Ask now; for up to some seconds each."""
        from hil.transport.diagnosis import why_not  # only when one is missing

        there = sum(status.present for status in self._watch.statuses()) + len(self._watch.silent())
        missing = self._endpoints if there < len(self._endpoints) else []
        faults = [(endpoint, why_not(endpoint, self._folder)) for endpoint in missing if not self._reached(endpoint)]
        self.lines = [f"nobody at {endpoint}: {fault.text}" for endpoint, fault in faults if fault]

    def _reached(self, endpoint: str) -> bool:
        """As far as links tell, which have ports and addresses but no names."""
        ports = [split(one)[2] for one in self._endpoints]
        port = split(endpoint)[2]
        return ports.count(port) == 1 and self._session.has_dialled(port)


def _paces(before: Status | None, values: Mapping[str, str], received_ns: int) -> dict[str, float]:
    """How fast counters ran since `before`; none after a restart, when they begin anew."""
    if before is None or before.values.get("exec_wall_ns") != values.get("exec_wall_ns"):
        return {}
    seconds = max((received_ns - before.received_ns) / NS_PER_S, 1e-3)
    if seconds < 0.2:  # two in a row tell nothing
        return dict(before.paces)
    paces = {}
    for name, counter in PACES.items():
        try:
            paces[name] = (float(values[counter]) - float(before.values[counter])) / seconds
        except (KeyError, ValueError):
            continue
    return paces
