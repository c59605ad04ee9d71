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
MAX_RANGES, MAX_RC = 6, 12


class ServoPacket(NamedTuple):
    """Packet that ArduPilot sends once per frame: requested rate (Hz), frame number, outputs (us)."""

    frame_rate: int
    frame_count: int
    pwm_us: tuple[int, ...]


class JsonState(NamedTuple):
    """State for ArduPilot.

    `time`: s. `gyro`: rad/s, and `acceleration`: m/s² (specific force), both FRD. `position` and `velocity`: NED, m and
    m/s. `quaternion`: w x y z, body to NED. Left out if empty: `ranges` (m; nan: no echo, which ArduPilot takes for no
    data, while it keeps the value of a name that is left out), `rc` (us), `battery` (V, A).
    """

    time: float
    gyro: Sequence[float]
    acceleration: Sequence[float]
    position: Sequence[float]
    velocity: Sequence[float]
    quaternion: Sequence[float]
    ranges: Sequence[float] = ()
    rc: Sequence[int] = ()
    battery: Sequence[float] = ()


def decode_servos(packet: bytes) -> ServoPacket | None:
    """Return the contents of a servo packet; None for another packet."""
    layout = _LAYOUTS.get(len(packet))
    if layout is None:
        return None
    magic, packed = layout
    packet_magic, rate, count, *pwm_us = packed.unpack(packet)
    return ServoPacket(rate, count, tuple(pwm_us)) if packet_magic == magic else None


def encode_state(state: JsonState) -> bytes:
    """Return the line for ArduPilot, which begins and ends with a line end."""
    parts = [
        f'"timestamp":{state.time:.6f}',
        f'"imu":{{"gyro":{_vector(state.gyro)},"accel_body":{_vector(state.acceleration)}}}',
        f'"position":{_vector(state.position)}',
        f'"velocity":{_vector(state.velocity)}',
        f'"quaternion":{_vector(state.quaternion)}',
        *[f'"rng_{number}":{value:.3f}' for number, value in enumerate(state.ranges[:MAX_RANGES], 1)],
    ]
    if state.rc:
        channels = [f'"rc_{number}":{pulse}' for number, pulse in enumerate(state.rc[:MAX_RC], 1)]
        parts.append(f'"rc":{{{",".join(channels)}}}')
    if state.battery:
        voltage, current = state.battery
        parts.append(f'"battery":{{"voltage":{voltage:.3f},"current":{current:.3f}}}')
    return f"\n{{{','.join(parts)}}}\n".replace(":nan", ":NaN").encode("ascii")


def _vector(values: Sequence[float]) -> str:
    return f"[{','.join([f'{value:.9f}' for value in values])}]"
