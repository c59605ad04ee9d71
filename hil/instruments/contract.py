"""What an instrument is: a codec between the samples of a sensor and the bytes of its device's wire.

    class Altimeter(Instrument):
        sensors = ("altimeter",)

        def on_sample(self, topic: str, stamped: Stamped, now_ns: int) -> None:
            self.send(f"{stamped.value.distance:.2f}\\r\\n".encode(), measured_ns=stamped.sent_ns)

An instrument does no I/O and has no clock: the process calls it with the time (monotonic ns), one call after another,
and it answers by `send`. It never raises on what comes off a wire: it counts that in `malformed` and goes on. It is
made again whenever its power comes back; only `facts.memory` outlives that, as the flash memory of a device does.

What it does by itself stands in `timers`: a function of two arguments, when it was due and the time now (monotonic ns),
and when that is. A function is taken out before it is called; one that comes again and again puts itself in again.
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from typing import Any, Literal, NamedTuple, Protocol

from hil.client.client import Stamped
from hil.common.clock import NEVER_NS
from hil.instruments import world
from hil.links.contract import Counters
from hil.links.frame.checksums import SUMS
from hil.links.search import find_frames
from sim.environment.seawater.pressure import pressure_at
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Sensor

Scene = world.Scene
WireKind = Literal["tcp", "udp", "udpout", "serial", "pty", "http"]


class Client(NamedTuple):
    """One partner of an instrument: the number of the wire in the sensor's key `at`, its kind, and who it is there."""

    wire: int
    kind: WireKind
    address: Hashable


def datagrams_to(host: str, port: int) -> Client:
    """Return a partner that need not have written: it gets datagrams from the instrument's first wire of UDP."""
    return Client(-1, "udp", (host, port))


class Facts(NamedTuple):
    """What an instrument knows of its vehicle and of the scenario.

    `name` is the section of its sensor in the scenario, `topic` that of the sensor's samples, `model` the record of the
    sensor's keys; `baud` (bit/s) the speed of its first line. `origin` is latitude and longitude (degrees) of the NED
    frame, None if the world has none; `origin_altitude` (m) the height of the surface there. `sound_speed` is the true
    one (m/s) at a depth (m), `pressure` (Pa) that of the water there. `memory` is kept while the power is off.
    """

    name: str
    topic: str
    model: Any
    baud: int = 115_200
    mounting: Mounting = Mounting()
    origin: tuple[float, float] | None = None
    origin_altitude: float = 0.0
    sound_speed: Callable[[float], float] = lambda _: 1500.0
    seed: int = 1
    memory: dict[str, Any] = {}  # noqa: RUF012  # the process gives each instrument its own
    pressure: Callable[[float], float] = pressure_at


class Response(NamedTuple):
    """Answer to a request of HTTP; a `stream` goes on in its connection's thread, and yields b"" to be looked after."""

    body: bytes = b""
    status: int = 200
    content_type: str = "application/json"
    stream: Iterator[bytes] | None = None


class Reader(Protocol):
    """Finds the messages in the bytes of one client, and counts in `malformed` what is none."""

    malformed: int

    def read(self, data: bytes, now_ns: int = 0) -> Iterable[Any]:
        """Return the messages that are complete with `data`. Never raises."""


class Lines:
    """Joins pieces to lines without their ends; of one without an end the last `longest` bytes count, in `rest`."""

    def __init__(self, longest: int) -> None:
        self.rest, self._longest = b"", longest
        self.malformed = self.read_ns = 0

    def read(self, data: bytes, now_ns: int = 0) -> Iterable[bytes]:
        """Return each line that is complete, except empty ones."""
        self.read_ns = now_ns
        *lines, rest = (self.rest + data).replace(b"\r", b"\n").split(b"\n")
        self.rest = rest[-self._longest :]
        return filter(None, lines)


class Frames(ABC):
    """Finds binary messages of at least a byte in any pieces, whatever lies between them; also their `Grammar`.

    A message may begin where `begin` matches, and ends with `checksum`, low byte first. A piece with bytes that belong
    to no message counts as malformed.
    """

    begin: re.Pattern[bytes]
    checksum = SUMS["sum16"]

    def __init__(self) -> None:
        self._rest, self.malformed = b"", 0

    def read(self, data: bytes, now_ns: int = 0) -> Iterable[Any]:
        """Return the bytes of each message that is complete with `data`."""
        buffer, counters = self._rest + data, Counters()
        frames, rest = find_frames(self, buffer, counters)
        self._rest, self.malformed = buffer[rest:], self.malformed + bool(counters.dropped_bytes)
        return [buffer[start:end] for start, end in frames]

    def find_start(self, buffer: bytes, position: int) -> int:
        """Return where the next message may begin: see `Grammar`."""
        found = self.begin.search(buffer, position)
        return found.start() if found else len(buffer)

    @abstractmethod
    def size_at(self, buffer: bytes, start: int) -> int:
        """Return the size of the message that may begin at `start`: see `Grammar`."""

    def is_sound(self, buffer: bytes, start: int, size: int) -> bool:
        """Return whether the checksum of the whole message at `start` is right."""
        end = start + size - self.checksum.size
        return self.checksum.of(buffer[start:end]) == int.from_bytes(buffer[end : start + size], "little")


Send = Callable[[bytes, Client | None, int], None]  # as `Instrument.send`


class NoSettings(NamedTuple):
    """Settings of an instrument that has none."""


class Instrument(ABC):  # noqa: B024  # every method has a sensible default
    """One instrument from power on to power off.

    `Model` is the record of its settings, the keys of [sensors.NAME.settings]. `sensors` are the kinds of sensors that
    it may be. `at` are the addresses where it stands unless the scenario names others, `wires` the kinds of its wires.
    It takes the topic of its sensor with `part` at its end; `also` are further topics, such as "odom". `baud` is that
    of a serial line until its address names another; with `automatic` bytes it takes the speed at which a client of a
    pty sends these. `first` are the bytes that the first message of a new client may begin with, if those are known:
    one that begins otherwise, such as a web page, is refused. One that `is_interactive` measures by the scene, which
    takes time: it gets a process of its own, so that the others do not wait. `warm_up_s` is the time from power on
    until it answers and measures, `delay_s` the one from measuring to sending that its maker names, 0 if none.
    """

    Model: type[Any] = NoSettings
    sensors: tuple[str, ...] = ()
    at: tuple[str, ...] = ()
    wires: tuple[WireKind, ...] = ("tcp", "serial", "pty")
    part = ""
    also: tuple[str, ...] = ()
    baud = 115_200
    automatic = b""
    first = b""
    longest = 256
    is_interactive = False
    warm_up_s = 0.0
    delay_s = 0.0

    def __init__(self, settings: Any, facts: Facts, scene: Scene, send: Send) -> None:
        self.settings, self.facts, self.scene = settings, facts, scene
        self._send = send
        self.baud = facts.baud
        self.change_baud: Callable[[int], None] = lambda _: None  # the process sets it
        self.malformed = 0  # messages off a wire that were not understood
        self.readers: dict[Client, Any] = {}  # by the clients that are there
        self.timers: dict[Callable[[int, int], object], int] = {}  # what is to be done -> when
        self._tuned: tuple[Any, Any] = (None, None)  # a record of keys, and the sensor with it
        self.prepare()

    def prepare(self) -> None:  # noqa: B027
        """Set its state at power on."""

    def send(self, data: bytes, to: Client | None = None, measured_ns: int = 0) -> None:
        """Send bytes to one client; without `to` to all that are there.

        A message that carries a measurement gives the instant of that (monotonic ns), for the measurement of delays.
        """
        self._send(data, to, measured_ns)

    def set_baud(self, baud: int) -> None:
        """Change the speed (bit/s) of its lines, if it is another, once what was sent has gone out."""
        if baud != self.baud:
            self.baud = baud
            self.change_baud(baud)

    def tuned(self, model: Any, mounting: Mounting | None = None, sensor: type[Sensor] | None = None) -> Any:
        """Return its sensor with these keys, as `Scene.build` does: the same one as long as `model` is the same."""
        if model != self._tuned[0]:
            self._tuned = model, self.scene.build(model, mounting, sensor)
        return self._tuned[1]

    def start(self, now_ns: int) -> None:  # noqa: B027
        """Begin: the warm-up is over."""

    def new_reader(self, client: Client) -> Reader:
        """Return the reader of a client: by default of lines, of which `longest` bytes count."""
        return Lines(self.longest)

    def connected(self, client: Client, now_ns: int) -> None:
        """Take up a new client; a serial line has one from the start, UDP one from its first datagram on."""
        self.readers[client] = self.new_reader(client)

    def disconnected(self, client: Client, now_ns: int) -> None:
        """Forget a client."""
        self.readers.pop(client, None)

    def on_data(self, client: Client, data: bytes, now_ns: int) -> None:
        """Take bytes of a client, in any pieces (UDP: one datagram), and hand on the messages that are complete."""
        reader = self.readers[client]
        for message in reader.read(data, now_ns):
            self.on_message(client, message, now_ns)
        self.malformed, reader.malformed = self.malformed + reader.malformed, 0

    def on_message(self, client: Client, message: Any, now_ns: int) -> None:  # noqa: B027
        """Carry out a message of a client. Never raises."""

    def on_sample(self, topic: str, stamped: Stamped, now_ns: int) -> None:  # noqa: B027
        """Take a sample of the vehicle: of its sensor (`facts.topic`) or of a topic in `also`.

        `stamped.value` is in NED and FRD with `time_ns` since 1970; `stamped.sent_ns` is the same instant, monotonic.
        """

    def tick(self, now_ns: int) -> int:
        """Do what is due; return when (monotonic ns) to be called again. Called after every other call too."""
        while (due_ns := min(self.timers.values(), default=NEVER_NS)) <= now_ns:
            happen = next(each for each, at_ns in self.timers.items() if at_ns == due_ns)
            del self.timers[happen]
            happen(due_ns, now_ns)
        return due_ns

    def on_request(self, method: str, path: str, query: Mapping[str, str], body: bytes, now_ns: int) -> Response:
        """Answer a request of HTTP, in the same thread as all else. Never raises."""
        return Response(b"", 404)
