"""A model of ArduPilot with its published JSON interface: it sends servo packets and waits for each answer."""

import json
import socket
import struct
from typing import Any

from hil.autopilots.json_packets import ServoPacket

PATIENCE_S = 60.0
MAGICS = {16: 18458, 32: 29569}  # by the number of outputs


def encode_servos(packet: ServoPacket) -> bytes:
    """Return the servo packet with these 16 or 32 outputs, as ArduPilot sends it."""
    outputs = len(packet.pwm_us)
    return struct.pack(f"<HHI{outputs}H", MAGICS[outputs], packet.frame_rate, packet.frame_count, *packet.pwm_us)


class ArdupilotPeer:
    """A peer of a simulator on a port of this machine; `time` and `position` are those of the last answer."""

    def __init__(self, port: int, channels: int = 16, first: int = 0) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(PATIENCE_S)
        self._address = ("127.0.0.1", port)
        self._channels = channels
        self.count = first
        self.time = -1.0
        self.position: list[float] = []
        self.state: dict[str, Any] = {}

    def send(self, *motors: int) -> None:
        pulses = (*motors, *[1500] * (self._channels - len(motors)))
        self.socket.sendto(encode_servos(ServoPacket(400, self.count, pulses)), self._address)

    def receive(self) -> dict[str, Any]:
        text = self.socket.recv(4096)
        assert text.startswith(b"\n{")
        assert text.endswith(b"}\n")
        self.state = json.loads(text)
        self.time, self.position = self.state["timestamp"], self.state["position"]
        self.count += 1
        return self.state

    def step(self, *motors: int) -> dict[str, Any]:
        self.send(*motors)
        return self.receive()

    def close(self) -> None:
        self.socket.close()
