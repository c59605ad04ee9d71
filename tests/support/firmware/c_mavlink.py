"""Scripts for the core in C with MAVLink packets, made with pymavlink."""

import random
from collections.abc import Callable, Iterator
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.support.firmware.c_core import Script, Step, cut, damaged, pulses

CHANNELS_OF_RC = 18
DEVICE = (1, 1)
# What the core knows; pymavlink's dialect knows more, and so finds packets where for the core is noise.
KNOWN = (0, 1, 20, 21, 22, 23, 36, 39, 40, 43, 44, 45, 47, 51, 70, 73, 76, 77, 110, 111)
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


def question(rng: random.Random) -> Any:
    """Return a message that a ground station sends to every vehicle, or as an answer to one."""
    to, kind, seq = _target(rng), rng.randrange(3), rng.randrange(3)
    name = rng.choice((b"SYSID_THISMAV", b"SYSID_THISMAV2", b"SYSID_THISMAV_AND", b"", b"OTHER"))
    numbers = [float(rng.randrange(5)) for _ in range(7)]
    return rng.choice((
        lambda: dialect.MAVLink_param_request_list_message(*to),
        lambda: dialect.MAVLink_param_request_read_message(*to, name, rng.choice((-1, 0, 1))),
        lambda: dialect.MAVLink_param_set_message(*to, name, 9.0, 9),
        lambda: dialect.MAVLink_mission_request_list_message(*to, kind),
        lambda: dialect.MAVLink_mission_request_message(*to, seq, kind),
        lambda: dialect.MAVLink_mission_request_int_message(*to, seq, kind),
        lambda: dialect.MAVLink_mission_count_message(*to, rng.choice((0, 3)), kind),
        lambda: dialect.MAVLink_mission_clear_all_message(*to, kind),
        lambda: dialect.MAVLink_mission_item_message(*to, seq, 3, 16, 0, 1, *numbers, kind),
        lambda: dialect.MAVLink_mission_item_int_message(*to, seq, 3, 16, 0, 1, *numbers[:4], 1, 2, 3.0, kind),
        lambda: dialect.MAVLink_file_transfer_protocol_message(0, *to, _file_request(rng)),
    ))()  # fmt: skip


def _file_request(rng: random.Random) -> list[int]:
    head = [*rng.choice(((5, 0), (255, 0), (255, 255))), rng.randrange(3), rng.choice((0, 1, 4, 15, 128, 129))]
    return list(bytes((*head, *rng.randbytes(rng.choice((0, 8, 247))))).ljust(251, b"\0"))


def _mostly(rng: random.Random, ordinary: float, odd_values: tuple[float, ...]) -> float:
    return ordinary if rng.random() < 0.6 else rng.choice(odd_values)


def _target(rng: random.Random) -> tuple[int, int]:
    return DEVICE if rng.random() < 0.8 else rng.choice(((0, 0), (1, 0), (0, 1), (1, 2), (3, 1)))


def _command(rng: random.Random, command: int, first: float, second: float) -> Any:
    return dialect.MAVLink_command_long_message(*_target(rng), command, 0, first, second, 0, 0, 0, 0, 0)


MESSAGES: tuple[Callable[[random.Random], Any], ...] = (
    *[servo_output_raw] * 6, *[rc_channels_override] * 2, *[arm_disarm] * 3, *[set_servo] * 3, timesync, unsupported,
    *[question] * 3,
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
