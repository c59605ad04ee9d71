"""The firmware's own C in this process, in place of its Python twin, where it was compiled and the link is its own."""

from hil.clock import NS_PER_US
from hil.links.contract import Wire


class FirmwareEnd:
    """As `firmware_stub.stub.Stm32End`; its time counts whole microseconds.

    channels: number of thrusters, 1 to 16. watchdog_ns: the longest silence before the outputs go to neutral.
    """

    def __init__(self, wire: Wire, channels: int, watchdog_ns: int) -> None:
        from hil.slave.native._firmware import Firmware

        self.wire = wire
        self._firmware = Firmware(channels, watchdog_ns // NS_PER_US)

    @property
    def deadline_ns(self) -> int:
        """When `service` has to be called even if no byte came: watchdog or telemetry."""
        return self._firmware.deadline_ns

    @property
    def pwm_us(self) -> tuple[int, ...]:
        """Pulse widths in effect, us."""
        return self._firmware.pwm_us

    @property
    def obeyed_ns(self) -> int:
        """When (monotonic ns) the outputs last took a command."""
        return self._firmware.obeyed_ns

    def fileno(self) -> int:
        """The descriptor to wait on for commands."""
        return self.wire.fileno()

    def service(self, now_ns: int) -> None:
        """Apply the commands that have come, answer each, then let time pass. Raises DeviceError without a wire."""
        for report in self._firmware.service(self.wire.read(), now_ns):
            self.wire.write(report)

    def close(self) -> None:
        """Outputs to neutral, and the wire closed."""
        self._firmware.stop()
        self.wire.close()
