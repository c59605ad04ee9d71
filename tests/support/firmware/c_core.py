"""The firmware core in C under sanitizers, and its specification in Python, both run with the same scripts."""

import io
import random
import struct
import subprocess
from collections.abc import Iterator
from typing import Any, NamedTuple

from firmware_stub.stub import Stm32, Stm32End
from hil.links.contract import Protocol, ThrusterCommand, ThrusterLink, ThrusterTelemetry, Wire
from hil.links.wires.can_frame import CanFrame
from tests.support.links.link_contract import uuv_hil

MAX_CHANNELS = 16
STOP, CAN = 65535, 65534  # in place of a size
SYNC = b"\xa5\x5a"
US = 1000  # ns
# Around every period there is, and far beyond the age that a report can tell.
STEPS_US = (0, 0, 1, 137, 1000, 5000, 10_000, 19_999, 20_000, 20_001, 50_000, 199_999, 200_000, 200_001, 1_000_000)
RARE_STEPS_US = (3_000_000, 5_000_000_000)
PULSES_US = (0, 799, 800, 1100, 1500, 1900, 2200, 2201, 0x5AA5, 0xFFFF)


class Step(NamedTuple):
    """A time, and the bytes received by then, or a frame from the CAN bus."""

    now_us: int
    data: bytes = b""
    can: CanFrame | None = None

    def record(self) -> bytes:
        """Return the bytes of the step as core_main.c reads them."""
        if self.can is None:
            return struct.pack("<QH", self.now_us, len(self.data)) + self.data
        return struct.pack("<QHIB8s", self.now_us, CAN, self.can.id, len(self.can.data), self.can.data)


class StepOutput(NamedTuple):
    """Output of the firmware at one step."""

    sent: bytes
    pwm_us: tuple[int, ...]
    deadline_us: int
    can: tuple[CanFrame, ...] = ()


class Script(NamedTuple):
    """All input of a firmware from its start to its end."""

    channels: int
    watchdog_us: int
    steps: list[Step]


def run_c(program: str, script: Script, stop: bool = False) -> list[StepOutput]:
    """Return the core's output, step by step; with `stop` also that of its end."""
    chunks = [struct.pack("<BI", script.channels, script.watchdog_us)]
    chunks += [step.record() for step in script.steps]
    if stop:
        chunks.append(struct.pack("<QH", script.steps[-1].now_us, STOP))
    process = subprocess.run([program, "run"], input=b"".join(chunks), capture_output=True)
    assert process.returncode == 0, process.stderr.decode()[-4000:]
    results = list(_results(process.stdout, script.channels))
    assert len(results) == len(script.steps) + stop
    return results


def _results(output: bytes, channels: int) -> Iterator[StepOutput]:
    file, steps = io.BytesIO(output), 0

    def read_items(code: str) -> tuple[Any, ...]:
        return struct.unpack(code, file.read(struct.calcsize(code)))

    while file.tell() < len(output):
        sent_bytes = file.read(*read_items("<H"))
        reported = [read_items("<IB8s") for _ in range(*read_items("<H"))]
        *pulses, kicks, deadline_us = read_items("<16HIQ")
        steps += 1
        assert kicks <= steps, "the watchdog is kicked once in each service"
        can = tuple(CanFrame(number, data[:size]) for number, size, data in reported)
        yield StepOutput(sent_bytes, tuple(pulses[:channels]), deadline_us, can)


class _Line(Wire):
    """A wire in memory that reads at most `piece` bytes at a time."""

    def __init__(self, chunk_size: int) -> None:
        self.name = "memory"
        self.incoming = self.outgoing = b""
        self._chunk_size = chunk_size

    def fileno(self) -> int:
        return -1

    def read(self) -> bytes:
        data, self.incoming = self.incoming[: self._chunk_size], self.incoming[self._chunk_size :]
        return data

    def write(self, data: bytes) -> int:
        self.outgoing += data
        return len(data)

    def close(self) -> None:
        pass


class Clock:
    """The clock (ns) of both implementations."""

    def __init__(self) -> None:
        self.now_ns = 0

    def __call__(self) -> int:
        return self.now_ns


def run_python(script: Script, protocol: Protocol, clock: Clock, chunk_size: int = 1) -> list[StepOutput]:
    """Return the specification's output; it gets bytes as a UART does, one by one, or in larger pieces."""
    wire = _Line(chunk_size)
    stm32 = Stm32(script.channels, script.watchdog_us * US)
    end = Stm32End(stm32, ThrusterLink(wire, protocol))
    results = []
    for step in script.steps:
        clock.now_ns = step.now_us * US
        wire.incoming += step.data
        _service(end, wire, clock.now_ns)
        results.append(StepOutput(wire.outgoing, tuple(stm32.pwm_us), end.deadline_ns // US))
        wire.outgoing = b""
    return results


def _service(end: Stm32End, wire: _Line, now_ns: int) -> None:
    """Serve the end as `Stm32End.service` does, for bytes that arrived one by one at the same time."""
    while wire.incoming:
        for message in end.link.receive():
            if end._apply(message, now_ns):
                end._report(now_ns)
    end.service(now_ns)


def first_difference(
    script: Script, c: list[StepOutput], python: list[StepOutput]
) -> tuple[Step, StepOutput, StepOutput] | None:
    """Return the first step at which the two differ."""
    return next((rows for rows in zip(script.steps, c, python, strict=True) if rows[1] != rows[2]), None)


def instants(rng: random.Random) -> Iterator[int]:
    """Yield the times of a script (us)."""
    now_us = 0
    while True:
        yield now_us
        now_us += rng.choice(RARE_STEPS_US if rng.random() < 0.01 else STEPS_US)


def cut(rng: random.Random, chunks: Iterator[bytes], count: int) -> list[Step]:
    """Return `count` steps; most pieces are whole, some are in two parts."""
    steps, remainder = [], b""
    for now_us, _ in zip(instants(rng), range(count), strict=False):
        data = remainder + b"".join(next(chunks) for _ in range(rng.choice((0, 0, 1, 1, 1, 2, 4))))
        at = rng.randrange(len(data) + 1) if rng.random() < 0.2 else len(data)
        steps.append(Step(now_us, data[:at]))
        remainder = data[at:]
    return steps


def pulses(rng: random.Random, channels: int) -> tuple[int, ...]:
    """Return pulse widths (us); most are ordinary ones."""
    return tuple(rng.choice(PULSES_US) if rng.random() < 0.2 else rng.randint(1100, 1900) for _ in range(channels))


def damaged(rng: random.Random, packet: bytes) -> bytes:
    """Return a packet after a bad line: a byte wrong, missing or doubled, or the end cut off."""
    position = rng.randrange(len(packet))
    kinds = (
        packet[:position] + bytes([packet[position] ^ rng.randint(1, 255)]) + packet[position + 1 :],
        packet[:position] + packet[position + 1 :],
        packet[: position + 1] + packet[position:],
        packet[:position],
    )
    return rng.choice(kinds)


def frame_pieces(rng: random.Random, channels: int, noisy: bool) -> Iterator[bytes]:
    """Yield frames from a host: mostly commands with the next number; with `noisy` also noise and damaged frames."""
    encode = uuv_hil().encode
    sequence = 0
    while True:
        sequence = sequence + rng.choice((1, 1, 1, 1, 0, -1, -5, -32, -33, -40, 300, 32768)) & 0xFFFF
        count = channels if rng.random() < 0.9 else rng.randint(1, MAX_CHANNELS)
        command = encode(ThrusterCommand(sequence, rng.random() < 0.8, pulses(rng, count)))
        if not noisy or rng.random() < 0.6:
            yield command
        else:
            yield _noise(rng, command)


def _noise(rng: random.Random, command: bytes) -> bytes:
    report = ThrusterTelemetry(1, True, False, (1500,), 0, 0, 0, 0)
    kinds = (
        damaged(rng, command),
        rng.randbytes(rng.randrange(60)),
        SYNC + rng.randbytes(rng.randrange(4)),
        SYNC * rng.randrange(9) + SYNC[:1],
        uuv_hil().encode(report),
        sealed(SYNC + bytes([rng.randrange(256), 1]), rng),  # a length that no command has
        sealed(SYNC + bytes([20, rng.randrange(256)]), rng),  # a message that nobody knows
        sealed(command[:7] + bytes([rng.randrange(256)]), rng),  # contradicts itself about its channels
    )
    return rng.choice(kinds)


def sealed(start: bytes, rng: random.Random) -> bytes:
    """Return a valid frame with this beginning, of the length that it declares."""
    import binascii

    body = (start + rng.randbytes(256))[: 4 + start[2]]
    return body + binascii.crc_hqx(body[2:], 0xFFFF).to_bytes(2, "little")


def frame_script(seed: int, steps: int, noisy: bool) -> Script:
    """Return a random script for a line with the frame protocol."""
    rng = random.Random(seed)
    channels = rng.randint(1, MAX_CHANNELS)
    watchdog_us = rng.choice((200_000, 200_000, 10_000, 1_000_000))
    return Script(channels, watchdog_us, cut(rng, frame_pieces(rng, channels, noisy), steps))
