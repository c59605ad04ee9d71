"""Output state of a MAVLink thruster controller: pulses and armed state."""

from collections.abc import Sequence
from typing import Any

from hil.links.contract import PWM_NEUTRAL_US, ThrusterCommand, ThrusterTelemetry
from hil.links.mavlink.end import sender


class Outputs:
    """Combine the commands of packets, most of which change only a part of the state."""

    def __init__(self, channels: int) -> None:
        self._neutral = [PWM_NEUTRAL_US] * channels
        self.armed = False
        self.pulses = self._neutral  # last commanded; the list is replaced, never changed
        self._commander: tuple[int, int] | None = None  # sender of the last command
        self._number = 0  # sequence number of its packet, 8 bits
        self._sequence = 0  # the same, extended to 16 bits

    def set_pulses(self, pulses: Sequence[int], armed: bool, packet: Any) -> ThrusterCommand:
        """Set these pulse widths (us), or neutral ones if not armed; return the command."""
        self.armed = armed
        self.pulses = list(pulses) if armed else self._neutral
        self._sequence = self._continue_number(packet)
        return ThrusterCommand(self._sequence, self.armed, tuple(self.pulses))

    def arm(self, armed: bool, packet: Any) -> ThrusterCommand | None:
        """Arm or disarm with the present pulse widths; return the command, None if nothing changes."""
        return None if armed == self.armed else self.set_pulses(self.pulses, armed, packet)

    def change(self, channel: int, pulse_us: int) -> list[int]:
        """Return the present pulse widths with one changed."""
        return [*self.pulses[:channel], pulse_us, *self.pulses[channel + 1 :]]

    def update_from_report(self, report: ThrusterTelemetry) -> None:
        """Use the STM32's reported state: it may have refused a command, or its watchdog may have tripped."""
        self.armed, self.pulses = report.armed, list(report.pwm_us)

    def _continue_number(self, packet: Any) -> int:
        """Return the sequence number of a packet's command, behind the last one if the packet is late."""
        number, commander = packet.get_seq(), sender(packet)
        step = (number - self._number + 128 & 0xFF) - 128 if commander == self._commander else 1
        self._number, self._commander = number, commander
        return self._sequence + step & 0xFFFF
