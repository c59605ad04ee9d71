"""An independent implementation of the shipped frames, from the tables in their files, with bitwise checksums."""

import struct
from collections.abc import Callable, Sequence
from typing import Any


def crc_bit_by_bit(data: bytes, width: int, polynomial: int, register: int, reflected: bool, final_xor: int) -> int:
    """Return a CRC by its definition: the register shifts left, reflection is done on the data."""
    for byte in data:
        for place in range(8):
            bit = byte >> (place if reflected else 7 - place) & 1
            out = register >> (width - 1) ^ bit
            register = (register << 1) & ((1 << width) - 1) ^ (polynomial if out else 0)
    if reflected:
        register = int(f"{register:0{width}b}"[::-1], 2)
    return register ^ final_xor


def modbus(data: bytes) -> bytes:
    crc = crc_bit_by_bit(data, 16, 0x8005, 0xFFFF, True, 0)
    return data + bytes([crc & 0xFF, crc >> 8])


def modbus_command(pulses: Sequence[int], armed: bool = True, **_: Any) -> bytes:
    registers = [int(armed), *pulses]
    body = b"".join(value.to_bytes(2, "big") for value in registers)
    head = bytes([0x01, 0x10, 0x01, 0x00, 0x00, len(registers), 2 * len(registers)])
    return modbus(head + body)


def modbus_telemetry(
    pulses: Sequence[int], armed: bool, timed_out: bool, frames: int, errors: int, watchdog_trips: int, **_: Any
) -> bytes:
    registers = [armed + 2 * timed_out, frames, errors, watchdog_trips, 0, *pulses]
    body = b"".join(value.to_bytes(2, "big") for value in registers)
    return modbus(bytes([0x01, 0x03, 2 * len(registers)]) + body)


def aa55(message_id: int, payload: bytes) -> bytes:
    counted = bytes([len(payload) + 1, message_id]) + payload
    return b"\xaa\x55" + counted + bytes([sum(counted) % 256])


def aa55_command(pulses: Sequence[int], sequence: int, armed: bool, **_: Any) -> bytes:
    thrusts = [round((width - 1500) * 1000 / 400) for width in pulses]
    return aa55(0x10, struct.pack(f"<BB{len(pulses)}h", sequence % 256, armed, *thrusts))


def aa55_telemetry(pulses: Sequence[int], sequence: int, armed: bool, timed_out: bool, age_us: int, **_: Any) -> bytes:
    start = struct.pack("<BBHHb", sequence % 256, armed + 128 * timed_out, round(age_us / 100), 0, 0)
    speeds = [struct.pack("<hH", round((width - 1500) * 3000 / 400), 0) for width in pulses]
    return aa55(0x20, start + b"".join(speeds))


def cobs(frame: bytes) -> bytes:
    """Encode byte by byte as in the COBS paper; frames of less than 254 bytes."""
    out, code_at = bytearray([0]), 0
    for byte in frame:
        if byte:
            out.append(byte)
        else:
            out[code_at] = len(out) - code_at
            code_at = len(out)
            out.append(0)
    out[code_at] = len(out) - code_at
    return bytes(out) + b"\0"


def crc32(data: bytes) -> bytes:
    return data + crc_bit_by_bit(data, 32, 0x04C11DB7, 0xFFFFFFFF, True, 0xFFFFFFFF).to_bytes(4, "little")


def cobs_command(pulses: Sequence[int], sequence: int, **_: Any) -> bytes:
    thrusts = [(width - 1500) / 10 for width in pulses]
    return cobs(crc32(struct.pack(f"<cH{len(pulses)}f", b"C", sequence, *thrusts)))


def cobs_telemetry(pulses: Sequence[int], sequence: int, age_us: int, errors: int, **_: Any) -> bytes:
    thrusts = [(width - 1500) / 10 for width in pulses]
    return cobs(crc32(struct.pack(f"<cHfH{len(pulses)}f", b"T", sequence, age_us / 1e6, errors, *thrusts)))


PEERS: dict[tuple[str, str], Callable[..., bytes]] = {
    ("modbus_like", "command"): modbus_command,
    ("modbus_like", "telemetry"): modbus_telemetry,
    ("aa55", "command"): aa55_command,
    ("aa55", "telemetry"): aa55_telemetry,
    ("cobs_thrust", "command"): cobs_command,
    ("cobs_thrust", "telemetry"): cobs_telemetry,
}
