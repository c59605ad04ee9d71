"""A model of PX4 with its published HIL interface: it connects, boots silently, then answers each HIL_SENSOR."""

import socket
import time
from collections.abc import Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.links.contract import Counters
from hil.links.mavlink.stream import MavlinkStream

PATIENCE_S = 20.0


class Px4Peer:
    """A peer of a simulator on a port of this machine; `received` counts messages by name, `last` has the newest."""

    def __init__(self, port: int) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while True:
            try:
                self.socket = socket.create_connection(("127.0.0.1", port), PATIENCE_S)
                break
            except ConnectionRefusedError:
                assert time.monotonic() < deadline
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.stream = MavlinkStream(1, 1, Counters())
        self.received: dict[str, int] = {}
        self.last: dict[str, Any] = {}
        self._sensors: list[Any] = []
        self.send(dialect.MAVLink_command_long_message(0, 0, 511, 0, 115, 5000, 0, 0, 0, 0, 0))
        self.send(dialect.MAVLink_heartbeat_message(0, dialect.MAV_AUTOPILOT_PX4, 0, 0, 0, 3))

    def send(self, message: Any) -> None:
        self.socket.sendall(self.stream.pack(message))

    def sensor(self) -> Any:
        """Return the next HIL_SENSOR."""
        while not self._sensors:
            data = self.socket.recv(4096)
            assert data, "the simulator has closed the connection"
            for message in self.stream.unpack(data):
                name = message.get_type()
                self.received[name] = self.received.get(name, 0) + 1
                self.last[name] = message
                if name == "HIL_SENSOR":
                    self._sensors.append(message)
        return self._sensors.pop(0)

    def send_reply(self, sensor: Any, controls: Sequence[float], armed: bool = True) -> None:
        """Answer it in lockstep."""
        filled = [*controls, *[0.0] * (16 - len(controls))]
        mode = 0x81 if armed else 0x01
        self.send(dialect.MAVLink_hil_actuator_controls_message(sensor.time_usec, filled, mode, 1))

    def close(self) -> None:
        self.socket.close()
