"""Scripts for the core in C with MAVLink packets, made with pymavlink."""

import random
from collections.abc import Callable, Iterator
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.support.firmware.c_core import Script, Step, cut, damaged, pulses

CHANNELS_OF_RC = 18
DEVICE = (1, 1)
# What the core knows; pymavlink's dialect knows more, and so finds packets where for the core is noise.
KNOWN = (0, 1, 36, 70, 76, 77, 111)
ODD_PARAMETERS = (
    0.0,
    1.0,
    2.0,
    6.0,
    16.0,
    17.0,
    -1.0,
    0.5,
    255.0,
    256.0,
    1e9,
    float("nan"),
    float("inf"),
    -float("inf"),
)
ODD_PULSES = (0.0, 799.0, 799.9, 800.0, 1500.5, 1501.5, 1600.4, 1600.6, 2200.0, 2200.1, -1.0, 1e30, float("nan"))


class Host:
    """A packer of messages from several components, most of them from the vehicle's computer."""

    def __init__(self, rng: random.Random) -> None:
        self._rng = rng
        self._senders = [
            dialect.MAVLink(None, *ids) for ids in ((1, 191), (1, 191), (1, 190), (255, 190), (2, 1), (1, 1))
        ]

    def pack(self, message: Any) -> bytes:
        """Return the packet, with the sender's next number, or one a little off."""
        rng = self._rng
        sender = self._senders[0] if rng.random() < 0.8 else rng.choice(self._senders)
        sender.signing.secret_key = b"k" * 32 if rng.random() < 0.05 else None
        sender.signing.sign_outgoing = sender.signing.secret_key is not None
        packet: bytes = message.pack(sender)
        sender.seq = sender.seq + (1 if rng.random() < 0.9 else rng.choice((0, 3, 127, 128, 129, 250))) & 0xFF
        return packet


def heartbeat() -> Any:
    return dialect.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)


def timesync(rng: random.Random) -> Any:
    return dialect.MAVLink_timesync_message(rng.choice((0, 0, 5)), rng.randint(-(2**63), 2**63 - 1))


def servo_output_raw(rng: random.Random) -> Any:
    port = 0 if rng.random() < 0.95 else 1
    return dialect.MAVLink_servo_output_raw_message(rng.getrandbits(32), port, *pulses(rng, 16))


def rc_channels_override(rng: random.Random) -> Any:
    widths = [
        rng.choice((0, 0xFFFF, 0xFFFE, 1)) if rng.random() < 0.5 else rng.randint(1100, 1900)
        for _ in range(CHANNELS_OF_RC)
    ]
    return dialect.MAVLink_rc_channels_override_message(*_target(rng), *widths)


def arm_disarm(rng: random.Random) -> Any:
    return _command(rng, dialect.MAV_CMD_COMPONENT_ARM_DISARM, _mostly(rng, 1.0, ODD_PARAMETERS), 0.0)


def set_servo(rng: random.Random) -> Any:
    instance = _mostly(rng, float(rng.randint(1, 8)), ODD_PARAMETERS)
    return _command(rng, dialect.MAV_CMD_DO_SET_SERVO, instance, _mostly(rng, 1600.0, ODD_PULSES))


def unsupported(rng: random.Random) -> Any:
    return _command(rng, rng.choice((22, 183 + 256, 65535)), 0.0, 0.0)


def _mostly(rng: random.Random, ordinary: float, odd_values: tuple[float, ...]) -> float:
    return ordinary if rng.random() < 0.6 else rng.choice(odd_values)


def _target(rng: random.Random) -> tuple[int, int]:
    return DEVICE if rng.random() < 0.8 else rng.choice(((0, 0), (1, 0), (0, 1), (1, 2), (3, 1)))


def _command(rng: random.Random, command: int, first: float, second: float) -> Any:
    return dialect.MAVLink_command_long_message(*_target(rng), command, 0, first, second, 0, 0, 0, 0, 0)


MESSAGES: tuple[Callable[[random.Random], Any], ...] = (
    *[servo_output_raw] * 6, *[rc_channels_override] * 2, *[arm_disarm] * 3, *[set_servo] * 3, timesync, unsupported,
)  # fmt: skip


def mavlink_pieces(rng: random.Random) -> Iterator[bytes]:
    """Yield packets to the device, some of them for others, some damaged, and noise between them."""
    host = Host(rng)
    while True:
        packet = host.pack(heartbeat() if rng.random() < 0.1 else rng.choice(MESSAGES)(rng))
        if rng.random() < 0.85:
            yield packet
        else:
            yield rng.choice((damaged(rng, packet), rng.randbytes(20), b"\xfd", b"\xfd\x21\0\0"))


def mavlink_script(seed: int, steps: int) -> Script:
    """Return a random script for a line with MAVLink from the start."""
    rng = random.Random(seed)
    channels = rng.randint(1, 16)
    hello = Host(random.Random(0)).pack(heartbeat())
    return Script(channels, 200_000, [Step(0, hello), *cut(rng, mavlink_pieces(rng), steps)])
