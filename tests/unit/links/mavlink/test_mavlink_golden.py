"""Our ends against packets made by plain pymavlink: what they decode, and byte for byte what they send."""

import json
import os
import runpy
from typing import Any

import pytest

from hil.links.contract import ThrusterCommand, ThrusterTelemetry
from hil.links.mavlink.end import MavlinkEnd
from hil.links.mavlink.reports import RPM
from hil.links.mavlink.settings import EscReading
from hil.links.mavlink.stream import TIMESTAMP_NS, TIMESTAMP_START_NS
from tests.support.links.mavlink_peer import Board, Clock, Peer, device_end, host_end

VECTORS = os.path.join(os.path.dirname(__file__), "..", "..", "..", "vectors")
HELD_PULSES = (1100, 1300, 1499, 1501, 1700, 1900)
NEUTRAL = (1500,) * 6
US = 1000

with open(os.path.join(VECTORS, "mavlink_thruster.json"), encoding="utf-8") as file:
    GOLDEN: dict[str, Any] = json.load(file)
TO_DEVICE = {row["name"]: row for row in GOLDEN["to_device"]}
FROM_DEVICE = {row["name"]: row for row in GOLDEN["from_device"]}


def at_number(end: MavlinkEnd, row: dict[str, Any]) -> None:
    """Give the end's next packet the number of this row."""
    end._stream._mavlink.seq = row["number"]


def test_the_vector_file_equals_the_output_of_its_generator() -> None:
    made = runpy.run_path(os.path.join(VECTORS, "make_mavlink_golden.py"))["golden"]()
    assert made | {"source": GOLDEN["source"]} == GOLDEN


def test_the_device_acts_on_the_vectors_as_stated() -> None:
    board, peer = Board(GOLDEN["channels"]), Peer()
    for row in GOLDEN["to_device"]:
        output = peer.parse(board.take(bytes.fromhex(row["bytes"])))
        acks = [message.result for message in output if message.get_type() == "COMMAND_ACK"]
        wanted = [] if row["result"] is None else [row["result"]]
        assert (board.stm32.armed, board.pwm_us, acks) == (row["armed"], row["pwm_us"], wanted), row["name"]
    counters = board.end.counters
    assert (board.stm32.refused, counters.malformed, counters.checksum_errors, counters.dropped_bytes) == (0, 0, 0, 0)


@pytest.mark.parametrize(
    ("name", "settings", "stamp_us", "order"),
    [
        ("pulses", {}, 1_000_000, ThrusterCommand(1, True, HELD_PULSES)),
        ("one pulse off", {}, 2_000_000, ThrusterCommand(1, True, (0, *HELD_PULSES[1:]))),
        (
            "controls, one of them off",
            {"command": "hil_actuator_controls"},
            1_000_000,
            ThrusterCommand(1, True, (1100, 1900, 1700, 1499, 0, 1500)),
        ),
    ],
)
def test_the_host_sends_the_golden_bytes(name: str, settings: Any, stamp_us: int, order: ThrusterCommand) -> None:
    row = TO_DEVICE[name]
    host = host_end(6, clock=Clock(stamp_us * US), **settings)
    host.feed(bytes.fromhex(FROM_DEVICE["heartbeat armed"]["bytes"]))
    at_number(host, row)
    assert host.encode(order).hex() == row["bytes"]


@pytest.mark.parametrize(("name", "armed", "says"), [("arm", True, "disarmed"), ("disarm", False, "armed")])
def test_the_host_arms_and_disarms_with_the_golden_bytes(name: str, armed: bool, says: str) -> None:
    row = next(row for row in GOLDEN["to_device"] if row["name"] == name)
    host = host_end(6)
    host.feed(bytes.fromhex(FROM_DEVICE[f"heartbeat {says}"]["bytes"]))
    at_number(host, row)
    assert host.encode(ThrusterCommand(1, armed, HELD_PULSES)).hex().startswith(row["bytes"])


def test_the_hosts_heartbeat_has_the_golden_bytes() -> None:
    assert host_end(6).tick(0).hex() == TO_DEVICE["heartbeat"]["bytes"]


def bytes_of(*names: str) -> str:
    return "".join([FROM_DEVICE[name]["bytes"] for name in names])


def test_the_device_sends_the_golden_bytes() -> None:
    device = device_end(6, clock=Clock(1_234_567 * US))
    armed = ThrusterTelemetry(0, True, False, HELD_PULSES, 0, 65_535, 258, 3)
    at_number(device, FROM_DEVICE["heartbeat armed"])
    assert device.encode(armed).hex() == bytes_of("heartbeat armed", "status armed", "report")
    timed_out = armed._replace(armed=False, timed_out=True, pwm_us=NEUTRAL)
    assert device.encode(timed_out).hex().startswith(bytes_of("heartbeat timed out", "status timed out"))


def test_the_devices_replies_have_the_golden_bytes() -> None:
    device = device_end(6, clock=Clock(9_876_543_210))
    at_number(device, FROM_DEVICE["acknowledgement"])
    device.feed(bytes.fromhex(TO_DEVICE["arm"]["bytes"]))
    assert device.replies().hex() == FROM_DEVICE["acknowledgement"]["bytes"]
    at_number(device, FROM_DEVICE["time"])
    device.feed(bytes.fromhex(TO_DEVICE["ask the time"]["bytes"]))
    assert device.replies().hex() == FROM_DEVICE["time"]["bytes"]


def test_the_esc_readings_have_the_golden_bytes() -> None:
    rpm, row = (955, 964, 974, 984), FROM_DEVICE["escs"]
    device, host = device_end(4), host_end(4)
    device.esc = [EscReading(rpm[i] * RPM, 14.81, 3.25 + i, 31.0 + i, 720.0) for i in range(4)]
    at_number(device, {"number": row["number"] - 2})  # heartbeat and status go before
    assert device.tick(0).hex().endswith(row["bytes"])
    host.feed(bytes.fromhex(row["bytes"]))
    assert host.esc[3] == pytest.approx((984 * RPM, 14.81, 6.25, 34.0, 720.0))


def test_the_host_decodes_the_golden_bytes() -> None:
    host = host_end(6)
    received = []
    for state, status in (("armed", "armed"), ("timed out", "timed out"), ("disarmed", "armed")):
        for name in (f"heartbeat {state}", f"status {status}", "report"):
            received += host.feed(bytes.fromhex(FROM_DEVICE[name]["bytes"]))
    reported = ThrusterTelemetry(0, True, False, HELD_PULSES, 0, 65_535, 258, 3)
    disarmed = reported._replace(armed=False)
    assert received == [reported, disarmed._replace(timed_out=True), disarmed]


def test_a_signature_has_the_golden_bytes() -> None:
    row = GOLDEN["signed"]
    wall = Clock(TIMESTAMP_START_NS + row["timestamp"] * TIMESTAMP_NS)
    board = Board(6, signing_key=row["key"], wall_clock=wall)
    board.take(bytes.fromhex(row["bytes"]))
    assert board.stm32.armed
    host = host_end(6, signing_key=row["key"], wall_clock=wall)
    host._device_armed = False
    assert host.encode(ThrusterCommand(1, True, HELD_PULSES)).hex().startswith(row["bytes"])
