"""Received bytes never raise in the MAVLink vehicle, signed or not."""

import os
import random
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.gateways.mavlink.flight.modes import Mode
from hil.gateways.mavlink.messages import TAKEN
from hil.gateways.mavlink.newer_messages import ProtocolVersion
from hil.gateways.mavlink.parameter_table import ParameterTable
from hil.gateways.mavlink.protocols.ftp import ACK, HEADER, OPEN_READ, FtpServer
from hil.links.contract import Counters
from hil.links.mavlink.stream import MavlinkStream
from tests.support.clients.mavlink_vehicle import Bench

COUNT = int(os.environ.get("UUV_HIL_FUZZ", "4000"))  # frames; 1000000 by hand


def _random_packet(generator: random.Random, stream: MavlinkStream, targets: bool) -> bytes:
    """Return a valid packet of a message that is handled, with random bytes in it."""
    kind = dialect.mavlink_map[getattr(dialect, f"MAVLINK_MSG_ID_{generator.choice(list(TAKEN))}")]
    payload = bytearray(generator.randbytes(kind.unpacker.size))
    message = kind(*_fields(kind, payload))
    if targets:
        for name in ("target_system", "target", "target_component"):
            if name in kind.fieldnames:
                setattr(message, name, 1)
    return stream.pack(message)


def _fields(kind: type, payload: bytearray) -> list[object]:
    """Return the fields of random bytes, as pymavlink has them."""
    values = kind.unpacker.unpack(payload)  # type: ignore[attr-defined]
    fields: list[object] = []
    position = 0
    in_order: dict[str, object] = {}
    for name, length in zip(kind.ordered_fieldnames, kind.array_lengths, strict=True):  # type: ignore[attr-defined]
        if length == 0 or isinstance(values[position], bytes):
            in_order[name], position = values[position], position + 1
        else:
            in_order[name], position = list(values[position : position + length]), position + length
    fields += [in_order[name] for name in kind.fieldnames]  # type: ignore[attr-defined]
    return fields


def test_random_bytes_never_raise() -> None:
    generator = random.Random(27)
    bench = Bench()
    for _ in range(COUNT // 20):
        bench.partner.feed(generator.randbytes(generator.randrange(1, 300)))
    bench.run(0.1)
    assert bench.partner.peer.counters.dropped_bytes > 0


def test_random_frames_never_raise() -> None:
    generator = random.Random(26)
    bench = Bench()
    bench.arm(Mode.GUIDED)
    stream = MavlinkStream(255, 190, Counters())
    for number in range(COUNT):
        packet = _random_packet(generator, stream, targets=number % 4 != 0)
        if number % 10 == 0:
            at = generator.randrange(len(packet))
            packet = packet[:at] + bytes((packet[at] ^ 1 << generator.randrange(8),)) + packet[at + 1 :]
        bench.partner.feed(packet)
        if number % 50 == 0:
            bench.run(0.02)
            bench.partner.received.clear()
    bench.run(1.0)
    assert bench.partner.take_messages("HEARTBEAT")


NAMES = (b"/logs\0", b"@PARAM/param.pck\0", b"/logs/run.mcap\0", b"/logs/runs\0", b"/logs/../../etc/passwd\0", b"")


def test_random_file_requests_never_raise(tmp_path: Path) -> None:
    generator = random.Random(28)
    (tmp_path / "run.mcap").write_bytes(bytes(5000))
    (tmp_path / "runs").mkdir()
    server = FtpServer(str(tmp_path), ParameterTable())
    opened = 0
    for _ in range(COUNT // 4):
        head = HEADER.pack(
            generator.randrange(1 << 16), generator.randrange(10), generator.randrange(20), generator.randrange(256),
            generator.randrange(256), generator.randrange(2), generator.choice((0, 5, 1 << 31, (1 << 32) - 1)),
        )  # fmt: skip
        path = generator.choice(NAMES) or generator.randbytes(9)
        answers = server.handle(head + path, (generator.randrange(3), 1, 1))
        assert all(len(answer) <= 251 for answer in answers)
        opened += sum(answer[3] == ACK and answer[5] == OPEN_READ for answer in answers)
    assert opened > 0


def test_the_definition_of_a_newer_message_has_the_right_checksum() -> None:
    mavparse = pytest.importorskip("pymavlink.generator.mavparse")
    size = {"uint16_t": 2, "uint8_t": 1}
    texts = ["uint16_t version", "uint16_t min_version", "uint16_t max_version", "uint8_t spec_version_hash 8",
             "uint8_t library_version_hash 8"]  # fmt: skip
    fields = []
    for text in texts:
        word, name, *length = text.split()
        field = type("Field", (), {"type": word, "name": name, "array_length": int(length[0]) if length else 0})
        field.type_length = size[word]  # type: ignore[attr-defined]
        fields.append(field)
    message = type("Message", (), {})()
    message.name = ProtocolVersion.msgname
    message.ordered_fields = sorted(fields, key=lambda field: -field.type_length)
    message.base_fields = lambda: len(fields)
    assert mavparse.message_checksum(message) == ProtocolVersion.crc_extra
    assert ProtocolVersion().pack(dialect.MAVLink(None, 1, 1))[10:-2].hex() == "c8006400c8", "versions 2, from 1 to 2"
