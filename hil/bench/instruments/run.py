"""Run the instruments of a scenario, read their wires, and measure the delay from each measurement to its last byte."""

import select
import time
from bisect import bisect_left
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from math import nan
from typing import NamedTuple

from hil.bench.harness import READY_S, Bench, program
from hil.bench.instruments.framing import Frame, split
from hil.bench.instruments.reader import ASKS, Ask, Reader, fetch, reader_of
from hil.common.clock import NS_PER_MS, NS_PER_S, now_ns
from hil.common.errors import NetworkError
from hil.common.quantiles import quantile
from hil.instruments.sent import Measurement, read_sent
from hil.instruments.table import load_instrument
from hil.scenario.instrument_records import InstrumentSpec, WireAddress

BITS_A_BYTE = 10
LINES = ("serial", "pty")
UNASKED = -1  # number of the wire of datagrams that nobody has asked for


class Message(NamedTuple):
    """Messages of one kind: how many, how many of them with a wrong checksum, and the last one's text."""

    kind: str
    number: int
    bad: int
    last: str


class Seen(NamedTuple):
    """One wire: its sensor, instrument and address, what came in `seconds`, delays and times on its line (ms).

    `own_ms` is the delay that the maker names, 0 if none. `remark` says why nothing was read.
    """

    sensor: str
    instrument: str
    at: str
    seconds: float
    messages: tuple[Message, ...] = ()
    delays_ms: tuple[float, ...] = ()
    lines_ms: tuple[float, ...] = ()
    own_ms: float = 0.0
    remark: str = ""

    def delay(self, share: float) -> float:
        """Return a quantile of the delays, ms."""
        return quantile(self.delays_ms, share)

    @property
    def line(self) -> float:
        """The median time that the line itself takes, ms."""
        return quantile(sorted(self.lines_ms), 0.5) if self.lines_ms else nan

    @property
    def problem(self) -> str:
        """What is wrong with it; "" if nothing."""
        if self.remark:
            return ""
        if not self.messages:
            return "nothing came"
        bad = sum(message.bad for message in self.messages)
        return f"{bad} messages have a wrong checksum" if bad else ""


def check(bench: Bench, seconds: float, endpoint: str = "") -> list[Seen]:
    """Return what is seen at each wire of the scenario's instruments, in their order.

    Starts the slave, unless it is at `endpoint`, and the instruments. Raises HilError.
    """
    sent_path = bench.file("sent")
    if not endpoint:
        slave = bench.start_slave()
        slave.expect("ready", READY_S)
    at = endpoint or bench.endpoint
    command = [*program(), "instruments", bench.path, "--connect", at, "--sent", sent_path]
    fitted = {name: spec.instrument for name, spec in bench.scenario.sensors.items() if spec.instrument}
    wires = [
        (name, number, address, ASKS.get(each.name, Ask()))
        for name, each in fitted.items()
        for number, address in enumerate(each.at)
        if address.kind not in ("serial", "http")
    ]
    with ExitStack() as stack:
        readers: list[tuple[str, int, Reader]] = []
        for is_early in (True, False):  # who only listens does so before the first datagram
            if not is_early:
                serving = bench.start("instruments", command)
                serving.expect("Ctrl-C", READY_S)
                for each in fitted.values():
                    _post(each)
            for name, number, address, ask in wires:
                if is_early == (address.kind == "udpout" or (address.kind == "udp" and bool(ask.group[0]))):
                    reader = reader_of(address, ask)
                    stack.callback(reader.close)
                    readers.append((name, number, reader))
        _read(readers, seconds, lambda: serving.running)
        if not serving.running:
            raise NetworkError(f"the process of the instruments {serving.ending}")
        by_wire = {(name, number): reader for name, number, reader in readers}
        measured = list(read_sent(sent_path))
        return [
            _seen(name, instrument.name, number, address, by_wire.get((name, number)), measured, seconds)
            for name, instrument in fitted.items()
            for number, address in enumerate(instrument.at)
        ]


def _post(instrument: InstrumentSpec) -> None:
    """Make it send, if it has to be told by HTTP, as soon as its process serves."""
    ask, deadline_ns = ASKS.get(instrument.name, Ask()), now_ns() + round(READY_S * NS_PER_S)
    for address in instrument.at:
        while ask.post and address.kind == "http":
            try:
                fetch(address, ask.post, ask.body)
                break
            except NetworkError:
                if now_ns() > deadline_ns:
                    raise
                time.sleep(0.05)


def _read(readers: Sequence[tuple[str, int, Reader]], seconds: float, is_running: Callable[[], bool]) -> None:
    """Read all wires for a time."""
    end_ns = now_ns() + round(seconds * NS_PER_S)
    by_fd = {reader.fileno(): reader for _, _, reader in readers}
    while (now := now_ns()) < end_ns and is_running():
        due_ns = min([reader.ask(now) for _, _, reader in readers], default=end_ns)
        wait_s = max(0, min(due_ns, end_ns, now + NS_PER_S) - now) / NS_PER_S
        for fd in select.select(list(by_fd), (), (), wait_s)[0]:
            by_fd[fd].read()


def _seen(
    name: str,
    instrument: str,
    number: int,
    address: WireAddress,
    reader: Reader | None,
    measured: Sequence[Measurement],
    seconds: float,
) -> Seen:
    own_ms = 1000.0 * load_instrument(instrument, name).delay_s
    seen = Seen(name, instrument, f"{address.kind}:{address.target}:{address.port}", seconds, own_ms=own_ms)
    if address.kind == "serial":
        return seen._replace(remark="is read at the other end of its cable")
    if reader is None:
        path = ASKS.get(instrument, Ask()).path
        took_s, status, body = fetch(address, path)
        text = body.decode("utf-8", "replace")
        message = Message(f"GET {path}", 1, int(status >= 500 and status != 503), f"{status} {text}")
        return seen._replace(messages=(message,), delays_ms=(1000.0 * took_s,))
    frames: dict[str, list[Frame]] = {}
    for frame in split(bytes(reader.data)):
        frames.setdefault(frame.kind, []).append(frame)
    messages = [
        Message(kind, len(found), sum(frame.ok is False for frame in found), found[-1].text)
        for kind, found in frames.items()
    ]
    numbers = (number, UNASKED) if address.kind == "udp" else (number,)
    here = [each for each in measured if each.name == name and each.wire in numbers]
    ends = [total for _, total in reader.arrivals]
    arrived = [(each, bisect_left(ends, each.total)) for each in here]
    delays = [(reader.arrivals[at][0] - each.measured_ns) / NS_PER_MS for each, at in arrived if at < len(ends)]
    per_byte = BITS_A_BYTE * 1000.0 / address.port if address.kind in LINES else 0.0
    return seen._replace(
        messages=tuple(messages),
        delays_ms=tuple(sorted(delays)),
        lines_ms=tuple([each.size * per_byte for each in here]),
    )
