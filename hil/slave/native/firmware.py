"""Run the firmware's own C in this process instead of the Python stub, where it is compiled and the link allows it."""

from hil.common.clock import NS_PER_US
from hil.links.contract import Protocol, Wire
from hil.links.frame.protocol import FrameProtocol, open_frame
from sim.native import has_native


class FirmwareEnd:
    """The interface of `firmware_stub.stub.Stm32End`; its time counts whole microseconds.

    channels: number of thrusters, 1 to 16. watchdog_ns: the longest silence before the outputs go to neutral.
    """

    def __init__(self, wire: Wire, channels: int, watchdog_ns: int) -> None:
        from hil.slave.native._firmware import Firmware

        self.wire = wire
        self._firmware = Firmware(channels, watchdog_ns // NS_PER_US)

    @property
    def deadline_ns(self) -> int:
        """Time (ns) at which `service` has to be called even if no byte came: watchdog or telemetry."""
        return self._firmware.deadline_ns

    @property
    def pwm_us(self) -> tuple[int, ...]:
        """Pulse widths in effect, us."""
        return self._firmware.pwm_us

    @property
    def command_ns(self) -> int:
        """Monotonic time (ns) at which the outputs last took a command."""
        return self._firmware.obeyed_ns

    def fileno(self) -> int:
        """Return the descriptor to wait on for commands."""
        return self.wire.fileno()

    def service(self, now_ns: int) -> None:
        """Apply the commands that have come, answer each, then let time pass. Raises DeviceError without a wire."""
        for report in self._firmware.service(self.wire.read(), now_ns):
            self.wire.write(report)

    def close(self) -> None:
        """Outputs to neutral, and the wire closed."""
        self._firmware.stop()
        self.wire.close()


def open_firmware(protocol: Protocol, wire: Wire, channels: int, watchdog_ns: int) -> FirmwareEnd | None:
    """Return the firmware on its end of `wire`; None where it was not compiled or speaks another frame than `protocol`.

    Raises ConfigError where the C is insisted on and not there.
    """
    if not has_native("hil.slave.native._firmware") or not isinstance(protocol, FrameProtocol):
        return None
    own = open_frame("device", channels)  # what the firmware is compiled for; both share what is read of one file
    return FirmwareEnd(wire, channels, watchdog_ns) if protocol.layout is own.layout else None
