"""Writes dronecan.json with the `dronecan` package (1.0.27), the reference implementation in Python.

pip install dronecan && python tests/vectors/make_dronecan_golden.py
"""

import json
from importlib import import_module
from pathlib import Path
from typing import Any

dronecan: Any = import_module("dronecan")
uavcan = dronecan.uavcan
Transfer = dronecan.transport.Transfer

RAW = [
    [0],
    [8191, -8191],
    [1, -1, 127, 128, -128, -129],
    [8191, -8192, 4096, -4096, 255, 256, -255, -256],
    [-8191 + 860 * i for i in range(20)],
]
ESC = [
    {"error_count": 0, "voltage": 16.0, "current": 0.0, "temperature": 288.0, "rpm": 0, "power_rating_pct": 0},
    {"error_count": 7, "voltage": 15.5, "current": -3.5, "temperature": 300.5, "rpm": -3500, "power_rating_pct": 99},
    {"error_count": 2**32 - 1, "voltage": 65504.0, "current": -65504.0, "temperature": 0.0, "rpm": 131071,
     "power_rating_pct": 127},
    {"error_count": 65536, "voltage": 0.25, "current": 24.0, "temperature": 318.0, "rpm": -131072,
     "power_rating_pct": 64},
]  # fmt: skip
NODE = [(0, 0, 0, 0), (86400, 1, 1, 0xBEEF), (2**32 - 1, 3, 7, 65535)]
BATTERY = {
    "temperature": 293.0, "voltage": 15.75, "current": -2.5, "average_power_10sec": 40.0,
    "remaining_capacity_wh": 200.0, "full_charge_capacity_wh": 266.0, "hours_to_full_charge": 1.5,
    "status_flags": 0x2A5, "state_of_health_pct": 127, "state_of_charge_pct": 75, "state_of_charge_pct_stdev": 5,
    "battery_id": 3, "model_instance_id": 0x12345678, "model_name": "4S LiPo",
}  # fmt: skip
UNIQUE_ID = list(range(0xA0, 0xB0))


def node_info(name: str) -> Any:
    info = uavcan.protocol.GetNodeInfo.Response()
    info.status = uavcan.protocol.NodeStatus(uptime_sec=77, health=1, mode=0, vendor_specific_status_code=6)
    info.software_version.major, info.software_version.minor = 3, 9
    info.hardware_version.major, info.hardware_version.minor = 1, 2
    info.hardware_version.unique_id = UNIQUE_ID
    info.name = name
    return info


def vector(name: str, fields: Any, payload: Any, transfer_id: int, **how: Any) -> dict[str, Any]:
    transfer = Transfer(transfer_id=transfer_id, payload=payload, **how)
    frames = [[f"{frame.message_id:08x}", bytes(frame.bytes).hex()] for frame in transfer.to_frames()]
    kind = dronecan.get_dronecan_data_type(payload)
    signature = f"{kind.get_data_type_signature():016x}"
    return {"name": name, "type": kind.full_name, "signature": signature, "fields": fields, "transfer_id": transfer_id,
            "payload": bytes(transfer.payload).hex(), "frames": frames}  # fmt: skip


def make() -> list[dict[str, Any]]:
    esc, protocol = uavcan.equipment.esc, uavcan.protocol
    at = {"source_node_id": 42, "transfer_priority": 8}
    made = [vector(f"raw {len(raw)}", raw, esc.RawCommand(cmd=raw), 31 - i, **at) for i, raw in enumerate(RAW)]
    made += [
        vector(f"esc {i}", {**e, "esc_index": 10 * i}, esc.Status(**e, esc_index=10 * i), i, **at)
        for i, e in enumerate(ESC)
    ]
    for i, (uptime, health, mode, code) in enumerate(NODE):
        status = protocol.NodeStatus(uptime_sec=uptime, health=health, mode=mode, vendor_specific_status_code=code)
        made.append(vector(f"node {i}", [uptime, health, mode, code], status, i, **at))
    made.append(vector("battery", BATTERY, uavcan.equipment.power.BatteryInfo(**BATTERY), 5, **at))
    for status in (0, 255):
        made.append(vector(f"arming {status}", status, uavcan.equipment.safety.ArmingStatus(status=status), 9, **at))
    service = {"service_not_message": True, "source_node_id": 42, "dest_node_id": 127, "transfer_priority": 16}
    for name in ("org.uuv-hil.stm32", "a" * 80):
        made.append(vector(f"info {len(name)}", name, node_info(name), 17, **service))
    for size, number in ((6, 0), (12, 0), (16, 125)):
        allocation = protocol.dynamic_node_id.Allocation(node_id=number, unique_id=UNIQUE_ID[:size])
        made.append(vector(f"allocation {size}", number, allocation, 2, **at))
    return made


if __name__ == "__main__":
    path = Path(__file__).parent / "dronecan.json"
    path.write_text(json.dumps(make(), indent=1) + "\n")
