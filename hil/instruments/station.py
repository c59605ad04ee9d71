"""One instrument with its wires, its power, and the faults of both."""

from collections.abc import Callable, Iterator
from functools import partial
from random import Random
from typing import Any, NamedTuple, TextIO

from hil.client.client import Stamped
from hil.common.clock import NEVER_NS, seconds_ns
from hil.instruments.contract import Client, Facts, Instrument, Response, Scene
from hil.instruments.wires import Wires
from hil.scenario.instrument_records import InstrumentFaults, InstrumentSpec

MOST_NOISE = 40  # random bytes at once


class Measurement(NamedTuple):
    """What was written: sensor, number of the wire, bytes of the message, of all to its client, when measured (ns)."""

    name: str
    wire: int
    size: int
    total: int
    measured_ns: int


class Station:
    """An instrument of the class `kind` from `began_ns` on. Raises NetworkError for a port in use.

    `report` gets lines for a person; the file `sent` a line for each `Measurement` that was written, for `uuv-hil
    instruments check`. `serve` is called for each request of HTTP with the station, method, path, query and body.
    """

    def __init__(
        self,
        spec: InstrumentSpec,
        kind: type[Instrument],
        facts: Facts,
        scene: Scene,
        began_ns: int,
        report: Callable[[str], None],
        serve: Callable[..., Response | None],
        sent: TextIO | None = None,
    ) -> None:
        self._spec, self._kind, self._facts, self._scene = spec, kind, facts, scene
        self._began_ns, self._report, self._serve, self._sent = began_ns, report, serve, sent
        self._faults = spec.faults
        self._random = Random(f"{facts.seed} {facts.name}")
        self._instrument: Instrument | None = None
        self.due_ns = NEVER_NS  # when (monotonic ns) something is due next
        self._written: dict[Client, int] = {}
        self._is_unplugged = self._is_started = False
        self._switch(began_ns)

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics that it needs."""
        return (self._facts.topic + self._kind.part, *self._kind.also)

    def descriptors(self) -> list[int]:
        """Return what to wait on."""
        return self._wires.descriptors() if self._instrument and not self._is_unplugged else []

    def on_sample(self, topic: str, stamped: Stamped, now_ns: int) -> None:
        """Take a sample of the vehicle."""
        if self._instrument and self._is_started:
            self._instrument.on_sample(topic, stamped, now_ns)
            self.due_ns = self._instrument.tick(now_ns)

    def on_request(self, method: str, path: str, query: dict[str, str], body: bytes, now_ns: int) -> Response | None:
        """Return the answer to a request of HTTP; None without power, before the warm-up, without cable."""
        instrument = self._instrument
        if instrument is None or not self._is_started or self._is_unplugged:
            return None
        response = instrument.on_request(method, path, query, body, now_ns)
        self.due_ns = instrument.tick(now_ns)
        return response._replace(stream=self._carry(response.stream, instrument)) if response.stream else response

    def _carry(self, stream: Iterator[bytes], instrument: Instrument) -> Iterator[bytes]:
        """Yield the pieces of a stream with the cable's faults, until the instrument has no power any more."""
        for piece in stream:
            if self._instrument is not instrument:
                return
            yield b"" if self._is_unplugged or not piece else _damage(piece, self._faults, self._random)

    def poll(self, now_ns: int) -> None:
        """Read what has come, and do what is due."""
        self._switch(now_ns)
        instrument, came = self._instrument, False
        if instrument is None:
            return
        for client, data in () if self._is_unplugged else self._wires.receive(now_ns):
            if not self._is_started:
                continue  # while it warms up, it loses what comes
            came = True
            if data is None:
                instrument.disconnected(client, now_ns)
                self._written.pop(client, None)
            elif data:
                instrument.on_data(client, data, now_ns)
            else:
                instrument.connected(client, now_ns)
        if came or now_ns >= self.due_ns:
            self.due_ns = instrument.tick(now_ns)

    def close(self) -> None:
        """Turn its power off, and close its wires."""
        if self._instrument:
            self._instrument, self._is_started, self.due_ns = None, False, NEVER_NS
            self._written.clear()
            self._wires.close()

    def _switch(self, now_ns: int) -> None:
        """Turn its power on and off, and pull its cable, as the faults want it."""
        seconds = (now_ns - self._began_ns) / 1e9
        self._is_unplugged = _is_within(self._faults.unplugged, seconds)
        has_power = not _is_within(self._faults.power_off, seconds)
        if has_power and self._instrument is None:
            self._wires = Wires(self._spec.at, self._kind, self._report, partial(self._serve, self))
            self._instrument = self._kind(self._spec.settings, self._facts, self._scene, self._send)
            self._instrument.change_baud = self._wires.set_baud
            self.due_ns = now_ns + seconds_ns(self._kind.warm_up_s)
        elif not has_power and self._instrument:
            self.close()
            self._report(f"{self._facts.name}: without power")
        if self._instrument and not self._is_started and now_ns >= self.due_ns:
            self._is_started = True
            self._instrument.start(now_ns)
            for client in self._wires.clients():
                self._instrument.connected(client, now_ns)
            self._report(f"{self._facts.name}: {self._spec.name} at {', '.join(self._wires.names)}")

    def _send(self, data: bytes, to: Client | None, measured_ns: int) -> None:
        if self._instrument is None or self._is_unplugged:
            return
        for client in [to] if to else self._wires.clients():
            damaged = _damage(data, self._faults, self._random)
            if damaged:
                self._wires.send(client, damaged)
                self._written[client] = self._written.get(client, 0) + len(damaged)
                if measured_ns and self._sent:
                    written = self._written[client]
                    line = Measurement(self._facts.name, client.wire, len(damaged), written, measured_ns)
                    self._sent.write(" ".join(map(str, line)) + "\n")  # at once: several processes write there


def _is_within(spans: tuple[tuple[Any, Any], ...], seconds: float) -> bool:
    return any(begin <= seconds < end for begin, end in spans)


def _damage(data: bytes, faults: InstrumentFaults, random: Random) -> bytes:
    """Return a message as it arrives; b"" if it is lost."""
    if faults.drop and random.random() < faults.drop:
        return b""
    if faults.corrupt:
        data = bytes(byte ^ (1 << random.randrange(8)) if random.random() < faults.corrupt else byte for byte in data)
    if faults.noise and random.random() < faults.noise:
        data = random.randbytes(random.randint(1, MOST_NOISE)) + data
    return data
