"""Run the firmware's C code in this process instead of the Python stub, if it is compiled and the link allows it."""

from hil.common.clock import NS_PER_US
from hil.links.contract import Protocol, Wire
from hil.links.frame.protocol import FrameProtocol, open_frame
from sim.native import has_native


class FirmwareEnd:
    """The firmware at the device's end of a wire; same interface as `firmware_stub.stub.Stm32End`, time in whole us.

    channels: number of thrusters, 1 to 16. watchdog_ns: time without a command after which the outputs go to neutral.
    """

    def __init__(self, wire: Wire, channels: int, watchdog_ns: int) -> None:
        from hil.slave.native._firmware import Firmware

        self.wire = wire
        self._firmware = Firmware(channels, watchdog_ns // NS_PER_US)

    @property
    def deadline_ns(self) -> int:
        """Monotonic time (ns) of the next watchdog check or telemetry, when `service` has to be called."""
        return self._firmware.deadline_ns

    @property
    def pwm_us(self) -> tuple[int, ...]:
        """Pulse widths in effect, us."""
        return self._firmware.pwm_us

    @property
    def command_ns(self) -> int:
        """Monotonic time (ns) at which the outputs last applied a command."""
        return self._firmware.executed_ns

    def fileno(self) -> int:
        """Return the descriptor to wait on for commands."""
        return self.wire.fileno()

    def service(self, now_ns: int) -> None:
        """Apply and answer the commands that have arrived; run the watchdog. Raises DeviceError if the wire is lost."""
        for report in self._firmware.service(self.wire.read(), now_ns):
            self.wire.write(report)

    def close(self) -> None:
        """Set the outputs to neutral and close the wire."""
        self._firmware.stop()
        self.wire.close()


def open_firmware(protocol: Protocol, wire: Wire, channels: int, watchdog_ns: int) -> FirmwareEnd | None:
    """Return the firmware at the device's end of `wire`; None if it is not compiled or `protocol` is not its own frame.

    Raises ConfigError if the user requires the C code and it is missing.
    """
    if not has_native("hil.slave.native._firmware") or not isinstance(protocol, FrameProtocol):
        return None
    own = open_frame("device", channels)  # the compiled-in layout; the same object if both come from the same file
    return FirmwareEnd(wire, channels, watchdog_ns) if protocol.layout is own.layout else None
