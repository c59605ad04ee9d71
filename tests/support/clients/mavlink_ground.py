"""A ground station of the MAVLink vehicle, with pymavlink."""

import os
import time
from collections.abc import Callable
from typing import Any

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.gateways.mavlink.flight.modes import Mode
from tests.support.processes import PATIENCE_S, wait_for


class Ground:
    """A ground station that sends its heartbeat while it waits."""

    def __init__(self, address: str, system: int = 255, **options: Any) -> None:
        os.environ["MAVLINK20"] = "1"
        self.link: Any = mavutil.mavlink_connection(address, source_system=system, dialect="ardupilotmega", **options)
        self.send = self.link.mav
        self._beat_s = 0.0

    def beat(self) -> None:
        if time.monotonic() - self._beat_s > 0.5:
            self._beat_s = time.monotonic()
            self.send.heartbeat_send(dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, 0, 0)

    def wait(
        self, kind: str, condition: Callable[[Any], object] = lambda _: True, do: Callable[[], Any] = lambda: None
    ) -> Any:
        """Return the first message of a kind that meets `condition`; call `do` meanwhile, 20 times a second."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            self.beat()
            do()
            message = self.link.recv_match(type=kind, blocking=True, timeout=0.05)
            if message and condition(message):
                return message
        raise AssertionError(f"no {kind} that fits came")

    def connect(self) -> Any:
        return self.wait("HEARTBEAT", lambda message: message.type == dialect.MAV_TYPE_SUBMARINE)

    def command(self, command: int, *params: float) -> int:
        values, sent_s = [*params, *[0.0] * (7 - len(params))], 0.0

        def send() -> None:
            nonlocal sent_s
            if time.monotonic() - sent_s > 2.0:  # a datagram may be lost
                sent_s = time.monotonic()
                self.send.command_long_send(1, 1, command, 0, *values)

        send()
        return int(self.wait("COMMAND_ACK", lambda ack: ack.command == command, send).result)

    def set_mode(self, mode: Mode) -> None:
        assert self.command(dialect.MAV_CMD_DO_SET_MODE, 1, mode) == 0
        self.wait("HEARTBEAT", lambda beat: beat.custom_mode == mode)

    def arm(self) -> None:
        """Arm, repeatedly while refused: on a busy machine the vehicle's samples may be too old for a moment."""
        assert wait_for(lambda: self.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1) == 0 or None)

    def disarm(self) -> None:
        assert self.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0) == 0

    def sticks(self, x: int = 0, y: int = 0, z: int = 500, r: int = 0) -> None:
        self.send.manual_control_send(1, x, y, z, r, 0)

    def read_position(self) -> Any:
        while self.link.recv_match(type="LOCAL_POSITION_NED", blocking=False):
            pass
        return self.wait("LOCAL_POSITION_NED")
