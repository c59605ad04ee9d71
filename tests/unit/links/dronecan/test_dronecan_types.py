"""DroneCAN payloads: round trips and limits; test_dronecan_interop compares them with the reference implementation."""

import math

from hil.links.dronecan.types import (
    EscStatus,
    pack_esc_status,
    unpack_esc_status,
)


def test_esc_status_values_are_limited_to_their_fields() -> None:
    packed = pack_esc_status(EscStatus(2**32 + 5, 1e9, -1e9, math.nan, 10**6, 400, 7))
    status = unpack_esc_status(packed)
    assert status is not None
    assert math.isnan(status.temperature_k)
    assert status._replace(temperature_k=0) == EscStatus(5, 65504, -65504, 0, 131071, 127, 7)
    below = unpack_esc_status(pack_esc_status(EscStatus(0, 0, 0, 0, -(10**6), -3, 0)))
    assert below == EscStatus(0, 0, 0, 0, -131072, 0, 0)
