"""Run the instruments of a scenario, read their wires, and measure the delay from each measurement to its last byte."""

import select
from bisect import bisect_left
from collections.abc import Callable, Collection, Sequence
from contextlib import ExitStack
from functools import partial
from math import nan
from typing import NamedTuple

from hil.bench.harness import READY_S, Bench, program
from hil.bench.instruments.framing import Frame, split
from hil.bench.instruments.reader import ASKS, Ask, Reader, post, wait_for
from hil.common.clock import NS_PER_MS, NS_PER_S, now_ns
from hil.common.errors import NetworkError
from hil.common.quantiles import quantile
from hil.instruments.station import Measurement
from hil.instruments.table import load_instrument
from hil.scenario.instrument_records import WireAddress

BITS_A_BYTE = 10
UNASKED = -1  # number of the wire of datagrams that nobody has asked for


class Message(NamedTuple):
    """Messages of one kind: how many, how many of them with a wrong checksum, and the last one's text."""

    kind: str
    number: int
    bad: int
    last: str


class Seen(NamedTuple):
    """One wire: its sensor, instrument and address, what came in `seconds`, and delays of `measurements`.

    `line_ms` is the median time that a message takes on its line, nan if no message has a measurement; `own_ms` the
    delay that the maker names, 0 if none. `remark` says why nothing was read.
    """

    sensor: str
    instrument: str
    at: str
    seconds: float
    own_ms: float
    messages: tuple[Message, ...] = ()
    measurements: int = 0
    delay_p50_ms: float = nan
    delay_p99_ms: float = nan
    line_ms: float = nan
    remark: str = ""

    @property
    def problem(self) -> str:
        """What is wrong with it; "" if nothing."""
        bad = sum(message.bad for message in self.messages)
        if bad:
            return f"{bad} messages have a wrong checksum"
        return "" if self.messages or self.remark else "nothing came"

    def with_delays(self, delays: Sequence[float]) -> "Seen":
        """Return it with these delays (ms)."""
        ordered = sorted(delays)
        p50, p99 = quantile(ordered, 0.5), quantile(ordered, 0.99)
        return self._replace(measurements=len(ordered), delay_p50_ms=p50, delay_p99_ms=p99)


class Wire(NamedTuple):
    """A wire: its sensor, instrument, number in the key `at`, address, and what a driver asks there."""

    sensor: str
    instrument: str
    number: int
    address: WireAddress
    ask: Ask


def check(bench: Bench, seconds: float, endpoint: str = "") -> list[Seen]:
    """Return what is seen at each wire of the scenario's instruments, in their order.

    Starts the slave, unless it is at `endpoint`, and the instruments. Raises HilError.
    """
    sent_path = bench.file("sent")
    if not endpoint:
        slave = bench.start_slave()
        slave.expect("ready", READY_S)
    wires = [
        Wire(name, spec.instrument.name, number, address, ASKS.get(spec.instrument.name, Ask()))
        for name, spec in bench.scenario.sensors.items()
        if spec.instrument
        for number, address in enumerate(spec.instrument.at)
    ]
    read = [wire for wire in wires if wire.address.kind != "serial"]
    early = [wire for wire in read if wire.ask.only_listens(wire.address)]
    readers: dict[Wire, Reader] = {}
    with ExitStack() as stack:
        _open(early, readers, stack)
        command = [*program(), "instruments", bench.path, "--connect", endpoint or bench.endpoint, "--sent", sent_path]
        serving = bench.start("instruments", command)
        serving.expect("Ctrl-C", READY_S)
        for sensor, _, _, address, ask in wires:
            if ask.post and address.kind == "http":
                [port] = [readers[wire].port for wire in early if wire.sensor == sensor]
                wait_for(address, partial(post, address, ask.post, ask.body % port))
        _open([wire for wire in read if wire not in early], readers, stack)
        _read(readers.values(), seconds, lambda: serving.running)
        if not serving.running:
            raise NetworkError(f"the process of the instruments {serving.ending}")
        with open(sent_path, encoding="utf-8") as file:
            rows = [text.split() for text in file if text.endswith("\n")]  # the last one may be incomplete
        measured = [Measurement(name, *map(int, numbers)) for name, *numbers in rows]
        return [_seen(wire, readers.get(wire), measured, seconds) for wire in wires]


def _open(wires: Sequence[Wire], readers: dict[Wire, Reader], stack: ExitStack) -> None:
    for wire in wires:
        readers[wire] = wait_for(wire.address, partial(Reader, wire.address, wire.ask))
        stack.callback(readers[wire].close)


def _read(readers: Collection[Reader], seconds: float, is_running: Callable[[], bool]) -> None:
    """Read all wires for a time."""
    end_ns = now_ns() + round(seconds * NS_PER_S)
    while (now := now_ns()) < end_ns and is_running():
        due_ns = min([end_ns, now + NS_PER_S, *[reader.ask(now) for reader in readers]])
        for reader in select.select([*readers], (), (), max(0, due_ns - now) / NS_PER_S)[0]:
            reader.read()


def _seen(wire: Wire, reader: Reader | None, measured: Sequence[Measurement], seconds: float) -> Seen:
    kind, target, port = wire.address
    own_ms = 1000.0 * load_instrument(wire.instrument, wire.sensor).delay_s
    seen = Seen(wire.sensor, wire.instrument, f"{kind}:{target}:{port}", seconds, own_ms)
    if reader is None:
        return seen._replace(remark="is read at the other end of its cable")
    frames: dict[str, list[Frame]] = {}
    for frame in split(bytes(reader.data)):
        frames.setdefault(frame.kind, []).append(frame)
    messages = [
        Message(name, len(found), sum(frame.ok is False for frame in found), found[-1].text)
        for name, found in frames.items()
    ]
    seen = seen._replace(messages=tuple(messages))
    if kind == "http":
        pairs = zip(reader.arrivals, reader.asked, strict=False)  # an answer comes whole, before the next request
        return seen.with_delays([(arrived_ns - asked_ns) / NS_PER_MS for (arrived_ns, _), asked_ns in pairs])
    numbers = (wire.number, UNASKED) if kind == "udp" else (wire.number,)
    here = [each for each in measured if each.name == wire.sensor and each.wire in numbers]
    ends = [total for _, total in reader.arrivals]
    arrived = [(each, bisect_left(ends, each.total)) for each in here]
    delays = [(reader.arrivals[at][0] - each.measured_ns) / NS_PER_MS for each, at in arrived if at < len(ends)]
    per_byte = BITS_A_BYTE * 1000.0 / port if kind == "pty" else 0.0
    line_ms = per_byte * quantile(sorted(each.size for each in here), 0.5)
    return seen._replace(line_ms=line_ms).with_delays(delays)
