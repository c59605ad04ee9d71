"""Packets of ArduPilot's JSON interface: servo packets in, lines of JSON out.

A servo packet is little-endian: magic, frame rate (Hz), frame count, then 16 or 32 pulse widths (us). The reply is one
JSON object between two line ends. ArduPilot searches for names with strstr and then skips a fixed number of characters.
Therefore the text has no blanks, and no name contains another name that comes later.
Source: ArduPilot, libraries/SITL/SIM_JSON.h and examples/JSON/readme.md.
"""

import struct
from collections.abc import Sequence
from typing import NamedTuple

MAGIC_16, MAGIC_32 = 18458, 29569
_LAYOUTS = {
    struct.calcsize(f"<HHI{count}H"): (magic, struct.Struct(f"<HHI{count}H"))
    for magic, count in ((MAGIC_16, 16), (MAGIC_32, 32))
}
MAX_RANGES = 6


class ServoPacket(NamedTuple):
    """Packet that ArduPilot sends once per frame: requested rate (Hz), frame number, outputs (us)."""

    frame_rate: int
    frame_count: int
    pwm_us: tuple[int, ...]


def decode_servos(packet: bytes) -> ServoPacket | None:
    """Return the contents of a servo packet; None for another packet."""
    layout = _LAYOUTS.get(len(packet))
    if layout is None:
        return None
    magic, packed = layout
    packet_magic, rate, count, *pwm_us = packed.unpack(packet)
    return ServoPacket(rate, count, tuple(pwm_us)) if packet_magic == magic else None


def encode_state(
    time: float, gyro: Sequence[float], acceleration: Sequence[float], position: Sequence[float],
    velocity: Sequence[float], quaternion: Sequence[float], ranges: Sequence[float] = (),
    battery: Sequence[float] = (),
) -> bytes:  # fmt: skip
    """Return the line for ArduPilot, which begins and ends with a line end.

    `time`: s. `gyro`: rad/s, and `acceleration`: m/s² (specific force), both FRD. `position` and `velocity`: NED, m and
    m/s. `quaternion`: w x y z, body to NED. Left out if empty: `ranges` (m; nan: no echo, which ArduPilot takes for no
    data, while it keeps the value of a name that is left out), `battery` (V, A).
    """
    parts = [
        f'"timestamp":{time:.6f}',
        f'"imu":{{"gyro":{_vector(gyro)},"accel_body":{_vector(acceleration)}}}',
        f'"position":{_vector(position)}',
        f'"velocity":{_vector(velocity)}',
        f'"quaternion":{_vector(quaternion)}',
        *[f'"rng_{number}":{value:.3f}' for number, value in enumerate(ranges[:MAX_RANGES], 1)],
    ]
    if battery:
        voltage, current = battery
        parts.append(f'"battery":{{"voltage":{voltage:.3f},"current":{current:.3f}}}')
    return f"\n{{{','.join(parts)}}}\n".replace(":nan", ":NaN").encode("ascii")


def _vector(values: Sequence[float]) -> str:
    return f"[{','.join([f'{value:.9f}' for value in values])}]"
