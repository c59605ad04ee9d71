"""DroneCAN's public library on a multicast bus ("mcast:7"): command and query the STM32 at node 20, and print JSON.

A process of its own, as the library's driver starts one more.
"""

import json
import os
import sys
import time
from importlib import import_module
from typing import Any

PATIENCE_S = 60.0


def main(url: str) -> None:
    dronecan: Any = import_module("dronecan")
    uavcan = dronecan.uavcan
    node = dronecan.make_node(url, node_id=99)
    node.mode = uavcan.protocol.NodeStatus().MODE_OPERATIONAL
    monitor: Any = import_module("dronecan.app.node_monitor").NodeMonitor(node)
    speeds: dict[int, int] = {}
    node.add_handler(
        uavcan.equipment.esc.Status, lambda event: speeds.update({event.message.esc_index: event.message.rpm})
    )

    def command() -> None:
        node.broadcast(uavcan.equipment.safety.ArmingStatus(status=255))
        node.broadcast(uavcan.equipment.esc.RawCommand(cmd=[8191, -8191, 0, 0, 0, 0]))

    node.periodic(0.05, command)
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        node.spin(0.02)
        named_nodes = [entry for entry in monitor.find_all(lambda _: True) if entry.info]
        if speeds.get(0) == 3500 and named_nodes:
            break
    node.can_driver.proc.terminate()  # which never ends by itself
    results = {
        "speeds": speeds,
        "nodes": {entry.node_id: bytes(entry.info.name).decode() for entry in named_nodes},
    }
    print(json.dumps(results), flush=True)
    os._exit(0)  # not waiting for its queues


if __name__ == "__main__":
    main(sys.argv[1])
