"""A ROS 2 client in a separate environment with pamoja-ros2 and zenoh, without this project.

    python pamoja_peer.py SETTINGS.json5 HASHES.json

Keys and CDR are that library's; the session has rmw_zenoh's settings. HASHES are those of the types by name, which it
cannot compute. Prints one JSON object.
"""

import json
import os
import struct
import sys
import threading
import time
from importlib import import_module
from pathlib import Path
from typing import Any

TWIST, RANGE, PRESSURE = "geometry_msgs/msg/Twist", "sensor_msgs/msg/Range", "sensor_msgs/msg/FluidPressure"


def main() -> None:
    ros2: Any = import_module("pamoja.ros2")
    zenoh: Any = import_module("zenoh")
    hashes = json.loads(Path(sys.argv[2]).read_text())
    session = zenoh.open(zenoh.Config.from_json5(Path(sys.argv[1]).read_text()))
    samples: list[tuple[bytes, bytes]] = []
    came = threading.Event()

    def keep(sample: Any) -> None:
        samples.append((sample.payload.to_bytes(), sample.attachment.to_bytes()))
        came.set()

    def key(topic: str, kind: str) -> str:
        return str(ros2.entity_key(0, topic, kind, hashes[kind]))

    subscription = session.declare_subscriber(key("/uuv1/pressure", PRESSURE), keep)
    node = f"@ros2_lv/0/{session.info.zid()}/0"
    tokens = [session.liveliness().declare_token(f"{node}/0/NN/%/%/pamoja")]
    mangled, dds = ros2.percent_mangle("/uuv1/cmd_vel"), ros2.dds_type_name(TWIST)
    tokens.append(
        session.liveliness().declare_token(f"{node}/1/MP/%/%/pamoja/{mangled}/{dds}/{hashes[TWIST]}/::,10:,:,:,,")
    )
    came.wait(60.0)
    command, start = key("/uuv1/cmd_vel", TWIST), time.monotonic()
    payload = ros2.twist_to_cdr((0.4, 0.0, 0.0), (0.0, 0.0, 0.0))
    sequence = 0
    while time.monotonic() - start < float(sys.argv[3]):
        sequence += 1
        session.put(command, payload, attachment=struct.pack("<qqB", sequence, time.time_ns(), 16) + bytes(range(16)))
        time.sleep(0.05)
    newest, attachment = samples[-1]
    reader = ros2.CdrReader(newest)
    stamp = reader.read_i32(), reader.read_u32()
    print(json.dumps({
        "received": len(samples), "key": command, "stamp": stamp, "attachment": len(attachment), "sent": sequence,
        "digest": bytes(ros2.type_hash_digest(hashes[TWIST])).hex(), "twist": bytes(payload).hex(),
        "declared": bool(subscription and tokens),
    }), flush=True)  # fmt: skip
    os._exit(0)  # its callbacks would keep the interpreter


if __name__ == "__main__":
    main()
