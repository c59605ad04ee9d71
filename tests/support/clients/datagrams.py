"""A real client of an instrument in simulated time: the client's socket, and its clock."""

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any
from unittest import mock

from hil.client.client import Stamped
from hil.instruments.contract import Client, Instrument
from sim.environment.world import World
from sim.sensors.sensor_set import load_sensor
from tests.support.fitted import FLAT, scene
from tests.support.instrument_bench import Bench

HOST = Client(0, "udp", ("192.0.2.1", 5000))


class Datagrams(Bench):
    """An instrument whose client reads by `recv`: while nothing is there, time passes to the next event.

    `log` are its messages: bytes, client, instant of measurement. The vehicle rests at 5 m depth.
    """

    def __init__(self, kind: type[Instrument], world: World = FLAT, settings: Any = None, **facts: Any) -> None:
        self.log: list[tuple[bytes, Client | None, int]] = []
        self._received: deque[bytes] = deque()
        super().__init__(kind, load_sensor(kind.sensors[0]).Model(), settings, **facts)
        self.scene.world = scene(world)
        self.scene.present = self.scene.world.state
        self.next_ns = self.now_ns

    def restart(self) -> None:
        """Switch the power off and on; the memory is kept."""
        self.device = self.kind(self.settings, self.facts, self.scene, self._take)
        self.device.start(self.now_ns)
        self.next_ns = self.now_ns

    def _take(self, data: bytes, to: Client | None = None, measured_ns: int = 0) -> None:
        self.log.append((data, to, measured_ns))
        self._received.append(data)

    def pass_time(self, seconds: float) -> None:
        """Let time pass, event by event."""
        self._run_until(self.now_ns + round(1e9 * seconds))

    def _run_until(self, end_ns: int) -> None:
        while self.next_ns <= end_ns:
            self.now_ns = max(self.next_ns, self.now_ns)
            self.next_ns = self.device.tick(self.now_ns)
        self.now_ns = end_ns

    def feed(self, value: Any, topic: str = "") -> None:
        """Give the instrument a sample, taken now."""
        self.device.on_sample(topic or self.facts.topic, Stamped(value, self.now_ns, self.now_ns), self.now_ns)
        self.next_ns = self.device.tick(self.now_ns)

    def send(self, data: bytes) -> int:
        """Send bytes of the client."""
        self.device.on_data(HOST, bytes(data), self.now_ns)
        self.next_ns = self.device.tick(self.now_ns)
        return len(data)

    def recv(self, _: int) -> bytes:
        """Return what the client receives next."""
        if not self._received:
            self._run_until(min(self.next_ns, self.now_ns + 100_000_000))
        if not self._received:
            raise BlockingIOError
        return self._received.popleft()

    @contextmanager
    def clock(self, module: str) -> Iterator[None]:
        """Give a module of a client the simulated time, which also passes while it sleeps."""
        time = SimpleNamespace(time=lambda: 1e-9 * self.now_ns, sleep=self.pass_time)
        with mock.patch(f"{module}.time", time):
            yield
