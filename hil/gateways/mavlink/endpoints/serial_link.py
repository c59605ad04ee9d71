"""A serial device as an endpoint of MAVLink, with one partner."""

import contextlib
from typing import Any

from hil.common.errors import DeviceError
from hil.gateways.mavlink.endpoints.links import RETRY_NS, Address, Link, Received
from hil.links.contract import Wire

TICKS_PER_S = 50


class SerialLink(Link):
    """A serial device, opened again when it is back."""

    def __init__(self, device: str, baud: int) -> None:
        self.name = f"serial:{device}:{baud}"
        self._device, self._baud = device, baud
        self.burst = max(300, baud // 10 // TICKS_PER_S // 2)  # half of what it carries
        self._wire: Wire | None = _open_port(device, baud)
        self._due_ns = 0

    def descriptors(self) -> list[int]:
        """Return the device's."""
        return [self._wire.fileno()] if self._wire else []

    def receive(self, now: int) -> Received:
        """Return what has come."""
        data = b""
        try:
            data = self._wire.read() if self._wire else b""
        except DeviceError:
            self._lose(now)
        return [(self._device, data)] if data else []

    def send(self, address: Address, data: bytes, message: Any) -> None:
        """Write a packet; what the device does not take is lost."""
        try:
            if self._wire:
                self._wire.write(data)
        except DeviceError:
            self._lose(0)

    def partners(self) -> list[Address]:
        """Return the device while it is open."""
        return [self._device] if self._wire else []

    def is_local(self, address: Address) -> bool:
        """Return true: it is a wire of this machine."""
        return True

    def tick(self, now: int) -> None:
        """Open the device again."""
        if self._wire is None and now >= self._due_ns:
            self._due_ns = now + RETRY_NS
            with contextlib.suppress(DeviceError):
                self._wire = _open_port(self._device, self._baud)

    def close(self) -> None:
        """Close the device."""
        if self._wire:
            self._wire.close()

    def _lose(self, now: int) -> None:
        self.close()
        self._wire, self._due_ns = None, now + RETRY_NS


def _open_port(device: str, baud: int) -> Wire:
    from hil.links.wires.terminal import UartWire  # needs a system with terminals; without a serial port none does

    return UartWire(device, baud)
