"""One instrument without a process: samples and a client's bytes in, what it sends out."""

from collections.abc import Iterable
from io import BytesIO
from types import SimpleNamespace
from typing import Any

from hil.client.client import Stamped
from hil.common.clock import NS_PER_S
from hil.common.plugins import load_object
from hil.instruments.contract import Client, Facts, Instrument
from sim.dynamics import State
from sim.environment.world import load_world
from sim.sensors.kinds import SENSORS
from sim.sensors.mounting import Mounting

WALL_NS = 1_790_000_000 * NS_PER_S + 123_456_789  # 21 September 2026, of the first sample
CLIENT = Client(0, "pty", "driver")


class Scene:
    """A scene whose state the test sets; sensors are the simulator's own, in the default world."""

    def __init__(self, facts: Facts) -> None:
        self.facts = facts
        self.present: State | None = State()
        world = load_world("open_water")._replace(origin=facts.origin, origin_altitude=facts.origin_altitude)
        self.world: Any = SimpleNamespace(world=world, wave_field=None)

    def build(self, model: Any = None, mounting: Mounting | None = None, sensor: Any = None) -> Any:
        """Return a sensor of the simulator."""
        model = model or self.facts.model
        sensor = sensor or load_object(SENSORS[self.facts.name].place, "test")
        return sensor(model, mounting or self.facts.mounting, self.facts.seed, self.world)

    def state(self, now_ns: int) -> State | None:
        """Return the state that the test has set."""
        return self.present

    def measure(self, sensor: Any, now_ns: int) -> Any:
        """Return a measurement of it."""
        return sensor.sample(now_ns, self.present)


class Bench:
    """An instrument from power on, with one client; `sent` is what came since it was taken last."""

    def __init__(
        self, kind: type[Instrument], model: Any, settings: Any = None, client: Client = CLIENT, **facts: Any
    ) -> None:
        self.client = client
        self.facts = Facts(kind.sensors[0], kind.sensors[0], model, memory={}, **{"baud": kind.baud} | facts)
        self.scene: Any = Scene(self.facts)
        self.kind, self.settings = kind, settings or kind.Model()
        self.now_ns = 10 * NS_PER_S
        self.restart()

    def restart(self) -> None:
        """Switch the power off and on; the memory is kept."""
        self.log: list[tuple[bytes, Client | None, int]] = []  # bytes, client, instant of measurement
        self.speeds: list[tuple[int, int]] = []  # bytes sent before a change of the line's speed, and the new one
        self.device = self.kind(self.settings, self.facts, self.scene, self.take)
        self.device.change_baud = lambda baud: self.speeds.append((sum(len(data) for data, *_ in self.log), baud))
        self.device.connected(self.client, self.now_ns)
        self.device.start(self.now_ns)
        self.next_ns = self.now_ns

    def take(self, data: bytes, to: Client | None, measured_ns: int) -> None:
        """Take what the device sends."""
        self.log.append((data, to, measured_ns))

    def tick(self) -> None:
        """Let the device do what is due."""
        self.next_ns = self.device.tick(self.now_ns)

    @property
    def sent(self) -> bytes:
        """Bytes sent since this was read last."""
        data, self.log[:] = b"".join(data for data, *_ in self.log), []
        return data

    def ask(self, data: bytes) -> bytes:
        """Return what the device sends upon a client's bytes."""
        self.log.clear()
        self.device.on_data(self.client, data, self.now_ns)
        self.tick()
        return self.sent

    def sample(self, value: Any, topic: str = "") -> bytes:
        """Return what the device sends upon a sample, taken now."""
        self.log.clear()
        self.feed(value, topic)
        return self.sent

    def feed(self, value: Any, topic: str = "") -> None:
        """Give the device a sample, taken now."""
        self.device.on_sample(topic or self.facts.topic, Stamped(value, self.now_ns, self.now_ns), self.now_ns)
        self.tick()

    def run(self, seconds: float, step_s: float = 0.01) -> bytes:
        """Return what it sends while only time passes."""
        self.log.clear()
        for _ in range(round(seconds / step_s)):
            self.now_ns += round(step_s * NS_PER_S)
            self.tick()
        return self.sent


class Line:
    """A serial line for a driver of others, always open: what it writes is answered at once."""

    is_open = True
    open = close = staticmethod(lambda: None)

    def __init__(self, device: Bench) -> None:
        self._device, self._answer = device, BytesIO()

    def reset_input_buffer(self) -> None:
        """Forget what was not read."""
        self._answer = BytesIO()

    def write(self, data: Iterable[int]) -> None:
        """Send to the device; what it answered before is lost."""
        self._answer = BytesIO(self._device.ask(bytes(data)))

    def read(self, size: int) -> bytes:
        """Return bytes of the answer."""
        return self._answer.read(size)

    def readline(self) -> bytes:
        """Return a line of the answer."""
        return self._answer.readline()


def crc_a001(data: bytes, start: int) -> int:
    """Return a CRC-16 as the manuals of MODBUS and SeaTrac compute it: reflected, polynomial 0xA001."""
    for byte in data:
        start ^= byte
        for _ in range(8):
            start = start >> 1 ^ (0xA001 if start & 1 else 0)
    return start
