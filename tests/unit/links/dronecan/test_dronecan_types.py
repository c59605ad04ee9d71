"""DroneCAN payloads by hand, compared with those of the reference implementation."""

import json
import math
import random
from pathlib import Path
from typing import Any

import pytest

from hil.links.can_thrusters import SPAN_US
from hil.links.dronecan import types
from hil.links.dronecan.transfer import CRC_START, data_type
from hil.links.dronecan.types import (
    Allocation,
    BatteryInfo,
    EscStatus,
    NodeInfo,
    NodeStatus,
    pack_allocation,
    pack_battery_info,
    pack_esc_status,
    pack_node_info,
    pack_node_status,
    pack_raw_command,
    unpack_allocation,
    unpack_battery_info,
    unpack_esc_status,
    unpack_node_status,
    unpack_raw_command,
)

GOLDEN: list[dict[str, Any]] = json.loads((Path(__file__).parents[3] / "vectors" / "dronecan.json").read_text())
UNIQUE_ID = bytes(range(0xA0, 0xB0))
GET_NODE_INFO_RESPONSE = types.GET_NODE_INFO._replace(max_size=377)
KINDS = {
    "uavcan.equipment.esc.RawCommand": types.RAW_COMMAND,
    "uavcan.equipment.esc.Status": types.ESC_STATUS,
    "uavcan.protocol.NodeStatus": types.NODE_STATUS,
    "uavcan.equipment.power.BatteryInfo": types.BATTERY_INFO,
    "uavcan.equipment.safety.ArmingStatus": types.ARMING_STATUS,
    "uavcan.protocol.GetNodeInfo": GET_NODE_INFO_RESPONSE,
    "uavcan.protocol.dynamic_node_id.Allocation": types.ALLOCATION,
}


def vectors(name: str) -> list[Any]:
    chosen = [vector for vector in GOLDEN if vector["type"].rpartition(".")[2] == name]
    assert chosen
    return [pytest.param(vector["fields"], bytes.fromhex(vector["payload"]), id=vector["name"]) for vector in chosen]


@pytest.mark.parametrize("vector", GOLDEN, ids=lambda vector: vector["name"])
def test_crc_seeds_and_sizes_equal_those_of_the_types(vector: dict[str, Any]) -> None:
    kind = KINDS[vector["type"]]
    assert data_type(0, int(vector["signature"], 16), 0).seed == kind.seed != CRC_START
    assert len(vector["payload"]) // 2 <= kind.max_size


@pytest.mark.parametrize(("raw", "payload"), vectors("RawCommand"))
def test_raw_commands_have_the_golden_bytes(raw: list[int], payload: bytes) -> None:
    assert pack_raw_command(raw) == payload
    assert unpack_raw_command(payload) == raw


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


@pytest.mark.parametrize(("fields", "payload"), vectors("Status"))
def test_esc_status_has_the_golden_bytes(fields: dict[str, Any], payload: bytes) -> None:
    status = EscStatus(*fields.values())
    assert pack_esc_status(status) == payload
    assert unpack_esc_status(payload) == status
    assert unpack_esc_status(payload[:-1]) is None
    assert unpack_esc_status(payload + b"\0") is None


def test_esc_status_values_are_limited_to_their_fields() -> None:
    packed = pack_esc_status(EscStatus(2**32 + 5, 1e9, -1e9, math.nan, 10**6, 400, 7))
    status = unpack_esc_status(packed)
    assert status is not None
    assert math.isnan(status.temperature_k)
    assert status._replace(temperature_k=0) == EscStatus(5, 65504, -65504, 0, 131071, 127, 7)
    below = unpack_esc_status(pack_esc_status(EscStatus(0, 0, 0, 0, -(10**6), -3, 0)))
    assert below == EscStatus(0, 0, 0, 0, -131072, 0, 0)


@pytest.mark.parametrize(("fields", "payload"), vectors("NodeStatus"))
def test_node_status_has_the_golden_bytes(fields: list[int], payload: bytes) -> None:
    assert pack_node_status(NodeStatus(*fields)) == payload
    assert unpack_node_status(payload) == NodeStatus(*fields)
    assert unpack_node_status(payload[1:]) is None


@pytest.mark.parametrize(("fields", "payload"), vectors("BatteryInfo"))
def test_battery_info_has_the_golden_bytes(fields: dict[str, Any], payload: bytes) -> None:
    names = dict(zip(BatteryInfo._fields, (
        "voltage", "current", "temperature", "average_power_10sec", "remaining_capacity_wh", "full_charge_capacity_wh",
        "hours_to_full_charge", "status_flags", "state_of_health_pct", "state_of_charge_pct",
        "state_of_charge_pct_stdev", "battery_id", "model_instance_id", "model_name",
    ), strict=True))  # fmt: skip
    battery = BatteryInfo(**{ours: fields[theirs] for ours, theirs in names.items()})
    assert pack_battery_info(battery) == payload
    assert unpack_battery_info(payload) == battery
    assert unpack_battery_info(payload[:22]) is None
    assert len(pack_battery_info(battery._replace(model_name="ü" * 99))) == types.BATTERY_INFO.max_size


@pytest.mark.parametrize(("name", "payload"), vectors("GetNodeInfo"))
def test_node_info_has_the_golden_bytes(name: str, payload: bytes) -> None:
    info = NodeInfo(name, UNIQUE_ID, (3, 9), (1, 2))
    assert pack_node_info(NodeStatus(77, 1, 0, 6), info) == payload


@pytest.mark.parametrize(("node_id", "payload"), vectors("Allocation"))
def test_allocation_has_the_golden_bytes(node_id: int, payload: bytes) -> None:
    allocation = Allocation(node_id, False, UNIQUE_ID[: len(payload) - 1])
    assert pack_allocation(allocation) == payload
    assert unpack_allocation(payload) == allocation
    assert unpack_allocation(b"") is None
    assert unpack_allocation(bytes(18)) is None
