"""Output state of a MAVLink thruster controller: pulses, armed state, and a motor test."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from hil.common.clock import NEVER_NS, NS_PER_MS, seconds_ns
from hil.links.contract import PWM_NEUTRAL_US, ThrusterCommand, ThrusterTelemetry
from hil.links.mavlink.end import sender

TEST_REPEAT_NS = 50 * NS_PER_MS


class _MotorTest(NamedTuple):
    channel: int
    pulse_us: int
    ends_ns: int


class Outputs:
    """Combine the commands of packets, most of which change only a part of the state.

    `clock` (ns) times motor tests; `step` has to be called at `wake_ns` during a test.
    """

    def __init__(self, channels: int, clock: Callable[[], int]) -> None:
        self._neutral = [PWM_NEUTRAL_US] * channels
        self.armed = False  # without a motor test
        self.pulses = self._neutral  # last commanded, without a motor test; the list is replaced, never changed
        self.wake_ns = NEVER_NS
        self._clock = clock
        self._test: _MotorTest | None = None
        self._commander: tuple[int, int] | None = None  # sender of the last command
        self._number = 0  # sequence number of its packet, 8 bits
        self._sequence = 0  # the same, extended to 16 bits

    def set_pulses(self, pulses: Sequence[int], armed: bool, packet: Any) -> ThrusterCommand:
        """Set these pulse widths (us), or neutral ones if not armed; end a running test; return the command."""
        self._end_test()
        self.armed = armed
        self.pulses = list(pulses) if armed else self._neutral
        return self._command(self._continue_number(packet))

    def arm(self, armed: bool, packet: Any) -> ThrusterCommand | None:
        """Arm or disarm with the present pulse widths; return the command, None if nothing changes."""
        if armed == self.armed and self._test is None:
            return None
        return self.set_pulses(self.pulses, armed, packet)

    def change(self, channel: int, pulse_us: int) -> list[int]:
        """Return the present pulse widths with one changed."""
        return [*self.pulses[:channel], pulse_us, *self.pulses[channel + 1 :]]

    def start_test(self, channel: int, pulse_us: int, seconds: float, packet: Any) -> ThrusterCommand:
        """Start a motor test and return its first command.

        One channel gets this pulse width (us) for `seconds`, armed or not; all others are neutral, and so is it at the
        end. The state before is discarded: the test resets the watchdog, and the host may have stopped sending.
        """
        self._test = _MotorTest(channel, pulse_us, self._clock() + seconds_ns(seconds))
        self.armed, self.pulses = False, self._neutral
        return self._command(self._continue_number(packet))

    def step(self) -> list[ThrusterCommand]:
        """Return the next command of a running test: a repetition, for the watchdog, or its end."""
        if self._test is None or self._clock() < self.wake_ns:
            return []
        if self._clock() >= self._test.ends_ns:
            self._end_test()
        return [self._command(self._sequence + 1)]

    def postpone(self, now_ns: int) -> None:
        """Set the next `wake_ns` after the last one has passed without a call of `step`."""
        self.wake_ns = now_ns + TEST_REPEAT_NS

    def update_from_report(self, report: ThrusterTelemetry) -> None:
        """Use the STM32's reported state: it may have refused a command, or its watchdog may have tripped."""
        if report.timed_out:
            self._end_test()
        if self._test is None:
            self.armed, self.pulses = report.armed, list(report.pwm_us)

    def _command(self, sequence: int) -> ThrusterCommand:
        self._sequence = sequence & 0xFFFF
        test = self._test
        if test is None:
            return ThrusterCommand(self._sequence, self.armed, tuple(self.pulses))
        self.wake_ns = min(self._clock() + TEST_REPEAT_NS, test.ends_ns)
        return ThrusterCommand(self._sequence, True, tuple(self.change(test.channel, test.pulse_us)))

    def _end_test(self) -> None:
        self._test = None
        self.wake_ns = NEVER_NS

    def _continue_number(self, packet: Any) -> int:
        """Return the sequence number of a packet's command, behind the last one if the packet is late."""
        number, commander = packet.get_seq(), sender(packet)
        step = (number - self._number + 128 & 0xFF) - 128 if commander == self._commander else 1
        self._number, self._commander = number, commander
        return self._sequence + step
