"""Feed random and damaged bytes to every decoder of received data.

    python -m tools.faults decoders --count 1000000     a million to each; some 10 minutes

The STM32's firmware in C runs under the address and undefined-behaviour sanitizers. The Python decoders must not raise,
hang or grow. The exit code is 1 when one does.
"""

import argparse
import itertools
import os
import random
import struct
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, get_args

import psutil

from firmware_stub import build
from hil.common.errors import HilError
from hil.common.scratch import ScratchFolder
from hil.links.contract import Message, Protocol, ThrusterCommand, ThrusterTelemetry
from hil.links.protocols import ON_CAN, PROTOCOLS, Role, open_protocol
from hil.links.wires.can_frame import RECORD_SIZE
from hil.ros.topics import TOPICS
from hil.scenario.records import Link
from hil.slave.drivers.ends import end_protocol
from tools.faults.instruments import instrument_decoders

SANITIZERS = ["-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
PULSES = (1100, 1900, 1600, 1400, 1700, 1650)
SLOWEST_S = 0.5  # of processor time, for one input
GROWTH_MIB = 8.0
LONGEST = 300  # bytes of noise
TICK_NS = 10_000_000


class Outcome(NamedTuple):
    """Result of one decoder over all its inputs; `fault` is "" if nothing is wrong."""

    name: str
    inputs: int
    seconds: float
    fault: str
    remark: str = ""

    @property
    def line(self) -> str:
        """Return the result for the terminal."""
        return f"{'FAIL' if self.fault else 'ok  '} {self.name}: {self.inputs} inputs, {self.seconds:.1f} s " + (
            self.fault or self.remark
        )


def main(arguments: list[str]) -> int:
    """Run all decoders; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.faults decoders",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--count", type=int, default=1_000_000, help="inputs to each decoder [%(default)s]")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    failed = False
    for outcome in outcomes(options.count, options.seed):
        print(outcome.line, flush=True)
        failed |= bool(outcome.fault)
    return int(failed)


def outcomes(count: int, seed: int) -> Iterator[Outcome]:
    """Yield results of the firmware, of both ends of each protocol, and of the network's decoders."""
    yield firmware(count, seed)
    for name, (decode, sound) in {**slave_decoders(), **network_decoders(), **instrument_decoders()}.items():
        yield feed(name, decode, sound, count, seed)
    for kind in PROTOCOLS:
        for role in get_args(Role):
            yield feed_link(kind, role, count, seed)


def firmware(count: int, seed: int, compiler: list[str] | None = None) -> Outcome:
    """Feed all protocols of the firmware's core, compiled with sanitizers or by `compiler` (command and options)."""
    began = time.monotonic()
    with ScratchFolder("decoders") as folder:
        source = os.path.join(os.path.dirname(__file__), "decoders.c")
        try:
            command = compiler or [*build.native_compiler(), *SANITIZERS]
            program = build.compile_core(folder.file("decoders"), [source], command, mavlink=True)
        except HilError as error:
            return Outcome("firmware in C", 0, 0.0, str(error))
        with open(folder.file("inputs"), "w+b") as file:
            file.writelines(firmware_inputs(random.Random(seed), count))
            file.seek(0)
            done = subprocess.run([program], stdin=file, capture_output=True, text=True, check=False)
    output = (done.stderr or done.stdout).strip().splitlines() or [""]
    fault = f"exit code {done.returncode}: {' / '.join(output[:8])}" if done.returncode else ""
    return Outcome("firmware in C, sanitized", count, time.monotonic() - began, fault, output[-1])


def firmware_inputs(rng: random.Random, count: int) -> Iterator[bytes]:
    """Yield the records of decoders.c: every third for CAN, half of their frames for us; at the end sound packets."""
    packets = list(sound_packets())
    for number in range(count):
        data = bytearray(_input(rng, rng.choice(packets), 1) + rng.choice((b"", rng.choice(packets))))
        if number % 3 == 0:
            for start in range(0, len(data) - RECORD_SIZE, 2 * RECORD_SIZE):
                data[start : start + 4] = struct.pack("<I", rng.randrange(64) << 8 | rng.randrange(20))
        yield struct.pack("<BHH", number % 3 == 0, rng.randrange(2000), len(data)) + data
    for packet in packets:
        yield struct.pack("<BHH", 2, 0, len(packet)) + packet


def sound_packets() -> Iterator[bytes]:
    """Return commands of all protocols on a serial line, armed and not, and other messages."""
    for kind in ("frame", "mavlink"):
        host = open_protocol(kind, "host", len(PULSES))
        for sequence in range(1, 20):
            yield host.encode(ThrusterCommand(sequence, sequence % 5 != 0, PULSES))
        host.deadline_ns = 0
        beat = host.tick(0)
        if beat:
            yield beat
    yield open_protocol("frame", "device", len(PULSES)).encode(ThrusterTelemetry(1, True, False, PULSES, 5, 1, 2, 3))


def slave_decoders() -> Mapping[str, tuple[Callable[[bytes], object], bytes]]:
    """Return name -> (decoder, valid payload) of both ends of the frame, as the slave decodes it."""
    decoders: dict[str, tuple[Callable[[bytes], object], bytes]] = {}
    for role in get_args(Role):
        other, message = _other_end("frame", role)
        decode = _messages_of(end_protocol(Link(), role, len(PULSES)))
        decoders[f"frame in the slave, {role}"] = decode, other.encode(message)
    return decoders


def feed_link(kind: str, role: Role, count: int, seed: int, **settings: str) -> Outcome:
    """Feed `count` inputs to one end of a protocol with those `settings`, then valid ones, which it must decode."""
    unit = RECORD_SIZE if kind in ON_CAN else 1  # frames of CAN get lost and are doubled as a whole
    decode = _messages_of(open_protocol(kind, role, len(PULSES), **settings), unit)
    other, message = _other_end(kind, role, **settings)
    name = " ".join((kind, *settings.values(), role))
    outcome = feed(name, decode, lambda: other.encode(message), count, seed, unit)
    # An unfinished message before it may cost the first.
    if outcome.fault or any(decode(other.encode(message)) for _ in range(20)):
        return outcome
    return outcome._replace(fault="a valid message is not decoded any more")


def _other_end(kind: str, role: Role, **settings: str) -> tuple[Protocol, Message]:
    """Return the end that sends to `role`, and what it sends: a command or a report."""
    other = open_protocol(kind, "device" if role == "host" else "host", len(PULSES), **settings)
    if role == "device":
        return other, ThrusterCommand(1, True, PULSES)
    return other, ThrusterTelemetry(1, True, False, PULSES, 5, 1, 2, 3)


def _messages_of(protocol: Protocol, unit: int = 1) -> Callable[[bytes], object]:
    """Return a decoder that gets its bytes in two pieces of whole units, answers, and lives 10 ms between inputs."""
    calls = itertools.count()

    def decode(data: bytes) -> object:
        half = len(data) // 2 // unit * unit
        messages = [*protocol.feed(data[:half]), *protocol.feed(data[half:])]
        protocol.replies()
        now_ns = next(calls) * TICK_NS
        if now_ns >= protocol.deadline_ns:
            protocol.tick(now_ns)
        return messages or None

    return decode


def network_decoders() -> Mapping[str, tuple[Callable[[bytes], object], bytes]]:
    """Return name -> (decoder, valid payload) of the network's payloads; the decoders must not raise."""
    from hil.gateways.json_lines.requests import read_request
    from hil.network.tokens import PING, PONG, read_clock, read_presence
    from hil.ros import encoders as ros
    from hil.ros import message as ros_message
    from hil.ros.commands import encode_number, encode_thrusts
    from hil.scenario.modem import decode_report

    sound = {
        "cmd_vel": ros.encode_twist((0.1, 0.2, 0.3), (0.0, 0.0, 0.1)),
        "cmd_depth": encode_number(3.0),
        "cmd_thrusters": encode_thrusts([1.0] * 6),
    }
    decoders: dict[str, tuple[Callable[[bytes], object], bytes]] = {}
    for topic in TOPICS:
        decode = ros.decoder(topic)
        if decode:
            decoders[f"topic {topic}"] = decode, sound.get(topic) or ros_message.encode(TOPICS[topic].type, {})
    for name in ("std_srvs/srv/SetBool_Request", "rcl_interfaces/srv/SetParameters_Request"):
        decoders[name] = _decoder_of(name, ros_message.decode), ros_message.encode(name, {})
    decoders["attachment"] = ros.unpack_attachment, ros.pack_attachment(1, 2, bytes(16))
    decoders["ping"] = (lambda data: read_clock(PING, data)), bytes(PING.size)
    decoders["pong"] = (lambda data: read_clock(PONG, data)), bytes(PONG.size)
    decoders["presence"] = (
        (lambda data: read_presence(data.decode("latin-1"))),
        b"uuv_hil/uuv1/alive/master/0/0a/laptop:1",
    )
    decoders["modem report"] = decode_report, bytes(range(24))
    decoders["gateway request"] = _refusing(read_request), b'{"id": 1, "do": "command", "surge": 0.1}'
    return decoders


def _decoder_of(name: str, decode: Callable[[str, bytes], object]) -> Callable[[bytes], object]:
    return lambda data: decode(name, data)


def _refusing(read: Callable[[bytes], Any]) -> Callable[[bytes], object]:
    """Return a decoder without its HilError, which the caller of `read` sends as the reply."""

    def decode(data: bytes) -> object:
        try:
            return read(data)
        except HilError:
            return None

    return decode


def feed(
    name: str,
    decode: Callable[[bytes], object],
    sound: bytes | Callable[[], bytes],
    count: int,
    seed: int,
    unit: int = 1,
) -> Outcome:
    """Feed `count` inputs of whole units to a decoder; the same seed gives the same inputs.

    `sound`: a valid payload, or what makes the next one, where a decoder drops one that comes twice.
    """
    rng = random.Random(f"{seed} {name}")
    began, slowest, held, decoded = time.monotonic(), 0.0, 0, 0
    for number in range(count):
        data = _input(rng, sound if isinstance(sound, bytes) else sound(), unit)
        at = time.thread_time()
        try:
            decoded += decode(data) is not None
        except Exception as error:  # noqa: BLE001  this is what we are here for
            return Outcome(name, number, time.monotonic() - began, f"{error!r} of {data.hex()}")
        slowest = max(slowest, time.thread_time() - at)
        if number == count // 10:
            held = psutil.Process().memory_info().rss
    growth = (psutil.Process().memory_info().rss - held) / 2**20
    fault = f"one input took {slowest:.2f} s" if slowest > SLOWEST_S else ""
    fault = fault or (f"memory grew by {growth:.1f} MiB" if growth > GROWTH_MIB else "")
    return Outcome(name, count, time.monotonic() - began, fault, f"{decoded} decoded")


def _input(rng: random.Random, sound: bytes, unit: int) -> bytes:
    """Return noise, or the valid payload, mutated."""
    if rng.random() < 0.3:
        return rng.randbytes(rng.randrange(LONGEST // unit) * unit)
    return mutate(rng, sound, unit)[: 4 * LONGEST // unit * unit]


def mutate(rng: random.Random, sound: bytes, unit: int = 1) -> bytes:
    """Return bytes with up to three faults: a bit flipped, a part cut off, doubled or lost, a number huge."""
    data = bytearray(sound)
    for _ in range(rng.randrange(4)):
        offset = rng.randrange(len(data) + 1)
        start = offset - offset % unit
        kind = rng.randrange(5)
        if kind == 0 and offset < len(data):
            data[offset] ^= 1 << rng.randrange(8)
        elif kind == 1:
            del data[start:]
        elif kind == 2:
            data[start:start] = data[: rng.randrange(len(data) // unit + 1) * unit]
        elif kind == 3:
            del data[start : start + unit]
        elif offset + 4 <= len(data):
            data[offset : offset + 4] = rng.choice((b"\xff\xff\xff\xff", b"\x00\x00\xf0\x7f", b"\xff\xff\xff\x7f"))
    return bytes(data)
