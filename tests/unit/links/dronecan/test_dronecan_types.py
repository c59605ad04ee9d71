"""DroneCAN payloads: round trips and limits; test_dronecan_interop compares them with the reference implementation."""

import math
import random

from hil.links.can_thrusters import SPAN_US
from hil.links.dronecan import types
from hil.links.dronecan.types import (
    EscStatus,
    pack_esc_status,
    pack_raw_command,
    unpack_esc_status,
    unpack_raw_command,
)


def test_raw_commands_of_every_length_survive_a_round_trip() -> None:
    source = random.Random(2)
    for count in range(21):
        raw = [source.randint(-8192, 8191) for _ in range(count)]
        assert unpack_raw_command(pack_raw_command(raw)) == raw


def test_every_pulse_width_has_its_own_raw_value() -> None:
    for microseconds in range(-SPAN_US, SPAN_US + 1):
        raw = round(microseconds * types.FULL_RAW / SPAN_US)
        assert abs(raw) <= types.FULL_RAW
        assert round(raw * SPAN_US / types.FULL_RAW) == microseconds


def test_esc_status_values_are_limited_to_their_fields() -> None:
    packed = pack_esc_status(EscStatus(2**32 + 5, 1e9, -1e9, math.nan, 10**6, 400, 7))
    status = unpack_esc_status(packed)
    assert status is not None
    assert math.isnan(status.temperature_k)
    assert status._replace(temperature_k=0) == EscStatus(5, 65504, -65504, 0, 131071, 127, 7)
    below = unpack_esc_status(pack_esc_status(EscStatus(0, 0, 0, 0, -(10**6), -3, 0)))
    assert below == EscStatus(0, 0, 0, 0, -131072, 0, 0)
