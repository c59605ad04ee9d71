"""A real client of an instrument in simulated time: the client's socket, and its clock."""

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any
from unittest import mock

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
        self._received: deque[bytes] = deque()
        super().__init__(kind, load_sensor(kind.sensors[0]).Model(), settings, HOST, **facts)
        self.scene.world = scene(world)
        self.scene.present = self.scene.world.state

    def take(self, data: bytes, to: Client | None, measured_ns: int) -> None:
        """Take what the device sends."""
        super().take(data, to, measured_ns)
        self._received.append(data)

    def pass_time(self, seconds: float) -> None:
        """Let time pass, event by event."""
        self._run_until(self.now_ns + round(1e9 * seconds))

    def _run_until(self, end_ns: int) -> None:
        while self.next_ns <= end_ns:
            self.now_ns = max(self.next_ns, self.now_ns)
            self.tick()
        self.now_ns = end_ns

    def send(self, data: bytes) -> int:
        """Send bytes of the client."""
        self.device.on_data(HOST, bytes(data), self.now_ns)
        self.tick()
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
