"""Feed random and mutated bytes to the decoders of a protocol, in pieces, and report the results.

    python tools/stress/fuzz_links.py frame --set frame=aa55                    a million strings to both ends
    python tools/stress/fuzz_links.py mavlink vesc --strings 100000 --seed 7

A string is noise, or valid messages of the other end with bytes flipped, cut, doubled or swapped. These are faults: an
exception, a string that takes more processor time than `SLOWEST_S`, memory that grows, and valid messages that are not
decoded afterwards. The exit code is 1 if there was a fault.
"""

import argparse
import random
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, get_args

import psutil

sys.path.insert(0, str(Path(__file__).parents[2]))

from hil.links.contract import Message, Protocol, ThrusterCommand, ThrusterTelemetry
from hil.links.protocols import ON_CAN, PROTOCOLS, Role, open_protocol
from hil.links.wires.can_frame import RECORD_SIZE

CHANNELS = 4
LONGEST = 120  # bytes of a string
SLOWEST_S = 0.5
GROWTH_BYTES = 8_000_000  # of the process, beyond its size after a tenth of the strings
TICK_NS = 10_000_000


class Result(NamedTuple):
    """Result of one end after all strings."""

    end: str
    strings: int
    size: int  # bytes
    messages: int
    slowest: float  # s of processor time, for one string
    growth: int  # bytes of memory at the end beyond those after a tenth
    seconds: float
    faults: tuple[str, ...]


def main() -> int:
    """Fuzz each end of each requested protocol; return the exit code."""
    options = _parser().parse_args()
    settings = dict(pair.split("=", 1) for pair in options.set)
    any_fault = False
    for kind in options.protocol or PROTOCOLS:
        for role in get_args(Role):
            result = fuzz(kind, role, options.strings, options.seed, settings)
            any_fault |= bool(result.faults)
            print(report(result), flush=True)
    return int(any_fault)


def fuzz(kind: str, role: Role, strings: int, seed: int = 1, settings: dict[str, str] | None = None) -> Result:
    """Feed `strings` strings to one end of a protocol with those `settings`; the same seed gives the same strings."""
    peer: Role = "device" if role == "host" else "host"
    own, other = (open_protocol(kind, end, CHANNELS, **(settings or {})) for end in (role, peer))
    rng = random.Random(seed)
    unit = RECORD_SIZE if kind in ON_CAN else 1
    faults: list[str] = []
    size = messages = 0
    held = 0
    slowest = 0.0
    begin = time.perf_counter()
    for number in range(strings):
        data = _string(rng, other, role, number, unit)
        at = time.thread_time()
        try:
            messages += sum(len(own.feed(piece)) for piece in _pieces(rng, data, unit))
            own.replies()
            if number * TICK_NS >= own.deadline_ns:
                own.tick(number * TICK_NS)
        except Exception as error:  # noqa: BLE001  this is what we are here for
            faults.append(f"string {number}, {data.hex()}: {error!r}")
            break
        slowest = max(slowest, time.thread_time() - at)
        size += len(data)
        if number == strings // 10:
            held = psutil.Process().memory_info().rss
    seconds = time.perf_counter() - begin
    growth = psutil.Process().memory_info().rss - held
    if slowest > SLOWEST_S:
        faults.append(f"one string took {slowest:.3f} s")
    if growth > GROWTH_BYTES:
        faults.append(f"memory grew by {growth} bytes")
    if not faults and not _recovers(own, other, role):
        faults.append("a valid message is not decoded any more")
    return Result(
        f"{kind} {' '.join((settings or {}).values())} {role}",
        strings,
        size,
        messages,
        slowest,
        growth,
        seconds,
        tuple(faults),
    )


def report(result: Result) -> str:
    """Return the state of one end as one or two lines."""
    line = (
        f"{' '.join(result.end.split())}: {result.strings} strings, {result.size} bytes, {result.messages} messages, "
        f"slowest {result.slowest * 1e3:.2f} ms, memory {result.growth:+d} bytes, {result.seconds:.0f} s"
    )
    return "\n".join([line, *(f"  FAULT: {fault}" for fault in result.faults)])


def _string(rng: random.Random, other: Protocol, role: Role, number: int, unit: int) -> bytes:
    if rng.random() < 0.3:
        return rng.randbytes(rng.randrange(LONGEST // unit + 1) * unit)
    data = b"".join(other.encode(_message(rng, role, number)) for _ in range(rng.randrange(1, 3)))
    mutated = bytearray(data)
    for _ in range(rng.randrange(4)):
        _mutate(rng, mutated, unit)
    return bytes(mutated)


def _mutate(rng: random.Random, data: bytearray, unit: int) -> None:
    """Make one fault of a line; on CAN, frames are lost, doubled and swapped, not bytes."""
    if not data:
        return
    offset = rng.randrange(len(data))
    start = offset - offset % unit
    kind = rng.randrange(5)
    if kind == 0:
        data[offset] ^= 1 << rng.randrange(8)
    elif kind == 1:
        data[offset] = rng.randrange(256)
    elif kind == 2:
        del data[start : start + unit * rng.randrange(1, 4)]
    elif kind == 3:
        data[start:start] = data[start : start + unit]
    else:
        data[start:start] = rng.randbytes(unit * rng.randrange(1, 6))


def _pieces(rng: random.Random, data: bytes, unit: int) -> Iterator[bytes]:
    """Yield the data as a wire does: all at once, or in pieces of whole records."""
    if rng.random() < 0.5:
        yield data
        return
    step = rng.randrange(1, 20) * unit
    yield from (data[start : start + step] for start in range(0, len(data), step))


def _message(rng: random.Random, role: Role, number: int) -> Message:
    """Return a message that the other end sends to `role`."""
    pulses = tuple(rng.randrange(1100, 1901) for _ in range(CHANNELS))
    if role == "device":
        return ThrusterCommand(number & 0xFFFF, rng.random() < 0.9, pulses)
    return ThrusterTelemetry(number & 0xFFFF, True, False, pulses, rng.randrange(1 << 20), 1, 2, 3)


def _recovers(own: Protocol, other: Protocol, role: Role) -> bool:
    """Return whether one of the next messages is decoded; an unfinished one before it may cost the first."""
    rng = random.Random(0)
    return any(own.feed(other.encode(_message(rng, role, number))) for number in range(20))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("protocol", nargs="*", help=f"{', '.join(PROTOCOLS)} [all]")
    parser.add_argument("--strings", type=int, default=1_000_000, help="to each end [%(default)s]")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a setting of the protocol")
    return parser


if __name__ == "__main__":
    sys.exit(main())
