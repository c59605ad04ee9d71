"""Samples of vehicles on the network, for the live view."""

import threading
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

from hil.client.delay import HOPS, DelayMeter
from hil.client.fleet import Fleet, connect
from hil.client.vehicle_handle import Vehicle
from hil.common.clock import now_ns
from hil.common.errors import NetworkError
from hil.common.quantiles import quantile
from hil.common.stop import Wakeup
from hil.ros.diagnostics import Diagnostics
from hil.ros.topics import ALL, first_of
from hil.scenario.config import Scenario
from hil.view.sources.plans import Plans
from hil.view.sources.recording import ViewRecorder
from hil.view.sources.source import Source

PICTURES = ("camera/image_raw/compressed", "camera/image_raw", "forward_sonar/image", "side_scan/image")
DISCOVERED_EVERY_NS = 2_000_000_000  # between two searches for further topics with pictures
POSITION_TOPICS = ("ground_truth", "odom")
NEWEST = 400  # commands whose delays are shown: the last 20 s of a master that sends 20 a second
LOG_LINES = 200
CONNECT_S = 5.0  # longest wait for a vehicle


class LiveSource(Source):
    """The vehicles at some endpoints. Use as a context. Pictures come over a separate session, while they are shown.

    With `observe` no vehicle is commanded. `keys` is this machine's folder of certificates. Recordings use the settings
    of `scenario`. Raises NetworkError.
    """

    def __init__(
        self,
        endpoints: Sequence[str],
        *,
        observe: bool = False,
        routed: bool = False,
        keys: str = "",
        scenario: Scenario | None = None,
    ) -> None:
        self._endpoints = endpoints
        self._routed, self._keys = routed, keys
        self._observe = observe
        self._fleet = self._connect(observe)
        how = self._fleet.endpoints, self._fleet.network, self._fleet.security
        self.recorder: ViewRecorder = ViewRecorder(*how, scenario)
        self._plans = Plans(*how)
        self._pictures: Fleet | None = None
        self._known: dict[str, Vehicle] = {}
        self.taken: dict[str, tuple[Fleet, Vehicle]] = {}
        self._present: dict[str, bool] = {}
        self._log: deque[str] = deque(maxlen=LOG_LINES)
        self._lock = threading.Lock()
        self._waking = threading.Lock()
        self._is_closed = False
        self._position_wakeup = Wakeup()
        self._discovery_ns = 0

    def __enter__(self) -> "LiveSource":
        self._plans.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self.recorder.stop()
        self._plans.__exit__()
        self._show_pictures(False)
        for held in self.taken.values():
            held[0].close()
        self._fleet.close()
        with self._waking:
            self._is_closed = True
            self._position_wakeup.close()

    def fileno(self) -> int:
        """Return a file descriptor that becomes readable when a vehicle's position was received."""
        return self._position_wakeup.fileno()

    def clear(self) -> None:
        """Make the file descriptor unreadable until the next position is received."""
        self._position_wakeup.clear()

    def _on_sample(self, topic: str) -> None:
        if topic in POSITION_TOPICS:
            with self._waking:
                if not self._is_closed:
                    self._position_wakeup.set()

    @property
    def names(self) -> list[str]:
        """Names of the vehicles that are or were present, sorted."""
        for name in self._fleet.names:
            if name not in self._known:
                self._add(name)
        for name, vehicle in self._known.items():
            self._report_presence(name, vehicle.present)
        return sorted(self._known)

    def is_present(self, name: str) -> bool:
        """Return True if the vehicle is present."""
        return self._known[name].present

    def latest(self, name: str) -> Mapping[str, Any]:
        """Return the newest value of each topic."""
        plan = {"plan": self._plans.latest[name]} if name in self._plans.latest else {}
        stamped = dict(self._known[name].client.latest)
        with self._lock:
            pictures = self._pictures
        if pictures and name in pictures.names:
            newest = dict(pictures[name].client.latest)
            stamped |= {topic: value for topic, value in newest.items() if first_of(topic) in PICTURES}
        return plan | {topic: each.value for topic, each in stamped.items()}

    def diagnostics(self, name: str) -> Diagnostics:
        """Return the newest diagnostics."""
        return self._known[name].diagnostics

    def vehicle(self, name: str) -> Vehicle | None:
        """Return the handle that commands the vehicle; None if this source only observes."""
        taken = self.taken.get(name)
        return None if self._observe else taken[1] if taken else self._known[name]

    def take_over(self, name: str, on: bool) -> str:
        """Command the vehicle in place of another master, by a session of its own, or give it back."""
        if self._observe or name not in self._known:
            return super().take_over(name, on)
        if held := self.taken.pop(name, None):
            held[0].close()
        if not on:
            return f"{name} is given back"
        fleet = self._connect(observe=False, take_over=True)
        try:
            self.taken[name] = fleet, fleet[name]
        except NetworkError:
            fleet.close()
            raise
        return f"{name} is taken over from {self.diagnostics(name).commander or 'another master'}"

    def delays_ms(self, name: str) -> tuple[list[float], dict[str, float]]:
        """Return the delays (ms) of the newest commands of all masters, and the median (ms) of each hop.

        The first hop starts by the master's clock and ends by the slave's. It is corrected by the clock offset that the
        slave has measured.
        """
        meter: DelayMeter = self._known[name].client.delays
        samples = meter.samples(NEWEST)
        if not samples:
            return [], {}
        offset_ns = round((self.diagnostics(name).clock_offset_ms or 0.0) * 1e6)
        networks = [sample.hops[0] + offset_ns for sample in samples]
        columns = [networks, *[[sample.hops[hop] for sample in samples] for hop in range(1, len(HOPS))]]
        medians = {hop: quantile(sorted(values), 0.5) / 1e6 for hop, values in zip(HOPS, columns, strict=True)}
        return [(sample.total_ns + offset_ns) / 1e6 for sample in samples], medians

    def show(self, viewed: bool, with_pictures: bool) -> None:
        """Subscribe to all samples when a browser is connected; open or close the session for pictures."""
        if viewed:
            for vehicle in self._known.values():
                vehicle.client.watch(ALL)
        self._show_pictures(viewed and with_pictures)

    def _show_pictures(self, is_shown: bool) -> None:
        with self._lock:
            pictures, self._pictures = self._pictures, None
            if is_shown:
                self._pictures = pictures or self._connect(observe=True)
                pictures = None
        if pictures:
            pictures.close()
        elif is_shown and self._pictures:
            for name in self._pictures.names:
                self._pictures[name].client.watch(*PICTURES)
            if now_ns() >= self._discovery_ns:
                self._discovery_ns = now_ns() + DISCOVERED_EVERY_NS
                for name in self._pictures.names:
                    shown = [topic for topic in self._pictures[name].pictures() if first_of(topic) in PICTURES]
                    self._pictures[name].client.watch(*shown)

    def log_lines(self) -> list[str]:
        """Return what happened since the last call."""
        lines = []
        while self._log:
            lines.append(self._log.popleft())
        return lines

    def _connect(self, observe: bool, take_over: bool = False) -> Fleet:
        how = {"observe": observe, "routed": self._routed, "take_over": take_over}
        return connect(*self._endpoints, **how, keys=self._keys, wait=CONNECT_S)

    def _add(self, name: str) -> None:
        try:
            vehicle = self._fleet.wait_for(name, seconds=0.0)[0]
        except NetworkError:  # it is present, but has sent nothing yet; the next update tries again
            return
        vehicle.client.watch(*POSITION_TOPICS)  # for the tracks, which are drawn without a browser too
        vehicle.notify(self._on_sample)
        self._known[name] = vehicle

    def _report_presence(self, name: str, present: bool) -> None:
        if self._present.get(name) != present:
            self._present[name] = present
            self._log.append(f"{name} is {'connected' if present else 'lost; waiting for it'}")
