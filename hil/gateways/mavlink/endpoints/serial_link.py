"""A serial device as an endpoint of MAVLink, with one partner."""

from typing import Any

from hil.common.errors import DeviceError
from hil.gateways.mavlink.endpoints.links import Address, Link, Received

TICKS_PER_S = 50


class SerialLink(Link):
    """A serial device. Raises DeviceError."""

    def __init__(self, device: str, baud: int) -> None:
        from hil.links.wires.terminal import UartWire  # needs a system with terminals; without a serial port none does

        self.name = f"serial:{device}:{baud}"
        self._device = device
        self.burst = max(300, baud // 10 // TICKS_PER_S // 2)  # half of what it carries
        self._wire = UartWire(device, baud)

    def descriptors(self) -> list[int]:
        """Return the device's."""
        return [self._wire.fileno()]

    def receive(self, now: int) -> Received:
        """Return what has come."""
        try:
            data = self._wire.read()
        except DeviceError:
            self.is_lost, data = True, b""
        return [(self._device, data)] if data else []

    def send(self, address: Address, data: bytes, message: Any) -> None:
        """Write a packet; what the device does not take is lost."""
        try:
            self._wire.write(data)
        except DeviceError:
            self.is_lost = True

    def partners(self) -> list[Address]:
        """Return the device."""
        return [self._device]

    def is_local(self, address: Address) -> bool:
        """Return true: it is a wire of this machine."""
        return True

    def close(self) -> None:
        """Close the device."""
        self._wire.close()
