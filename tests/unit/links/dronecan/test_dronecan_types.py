"""DroneCAN payloads: round trips and limits; test_dronecan_interop compares them with the reference implementation."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from hil.links.dronecan import types
from hil.links.dronecan.types import EscStatus, pack_esc_status, unpack_esc_status


def test_esc_status_values_are_limited_to_their_fields() -> None:
    packed = pack_esc_status(EscStatus(2**32 + 5, 1e9, -1e9, math.nan, 10**6, 400, 7))
    status = unpack_esc_status(packed)
    assert status is not None
    assert math.isnan(status.temperature_k)
    assert status._replace(temperature_k=0) == EscStatus(5, 65504, -65504, 0, 131071, 127, 7)
    below = unpack_esc_status(pack_esc_status(EscStatus(0, 0, 0, 0, -(10**6), -3, 0)))
    assert below == EscStatus(0, 0, 0, 0, -131072, 0, 0)


@pytest.mark.parametrize(
    ("unpack", "least", "most"),
    [(types.unpack_esc_status, 14, 14), (types.unpack_node_status, 7, 7), (types.unpack_arming_status, 1, 1),
     (types.unpack_allocation, 1, 17)],
)  # fmt: skip
def test_a_payload_of_another_length_is_no_message(unpack: Callable[[bytes], Any], least: int, most: int) -> None:
    assert [size for size in range(99) if unpack(bytes(size)) is not None] == list(range(least, most + 1))
