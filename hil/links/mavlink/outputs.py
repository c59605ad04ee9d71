"""What the outputs of a MAVLink thruster controller are to be: pulses, armed or not, and a motor test on top."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from hil.clock import NEVER_NS, NS_PER_MS, seconds_ns
from hil.links.contract import PWM_NEUTRAL_US, ThrusterCommand, ThrusterTelemetry
from hil.links.mavlink.end import sender

TEST_REPEAT_NS = 50 * NS_PER_MS


class _MotorTest(NamedTuple):
    channel: int
    pulse_us: int
    ends_ns: int


class Outputs:
    """The commands of packets, of which most change a part of what held before.

    `clock` (ns) times motor tests; `wake_ns` is when one that runs wants `step` to be called.
    """

    def __init__(self, channels: int, clock: Callable[[], int]) -> None:
        self._neutral = [PWM_NEUTRAL_US] * channels
        self.armed = False  # apart from a test
        self.pulses = self._neutral  # as ordered last, apart from a test; a list is never changed, only replaced
        self.wake_ns = NEVER_NS
        self._clock = clock
        self._test: _MotorTest | None = None
        self._commander: tuple[int, int] | None = None  # who sent the last command
        self._number = 0  # of its packet
        self._sequence = 0  # that number, continued to 16 bits

    def order(self, pulses: Sequence[int], armed: bool, packet: Any) -> ThrusterCommand:
        """These pulses (us) from now on, neutral ones if not armed. A test that runs is over."""
        self._end_test()
        self.armed = armed
        self.pulses = list(pulses) if armed else self._neutral
        return self._command(self._continue_number(packet))

    def arm(self, armed: bool, packet: Any) -> ThrusterCommand | None:
        """Armed or not from now on, with the pulses that hold; None if that changes nothing."""
        if armed == self.armed and self._test is None:
            return None
        return self.order(self.pulses, armed, packet)

    def change(self, channel: int, pulse_us: int) -> list[int]:
        """The pulses that held before, with this one changed."""
        return [*self.pulses[:channel], pulse_us, *self.pulses[channel + 1 :]]

    def start_test(self, channel: int, pulse_us: int, seconds: float, packet: Any) -> ThrusterCommand:
        """One channel gets this pulse (us) for so many seconds, armed or not; the others, and then it too, are neutral.

        What held before is forgotten: the test keeps the watchdog waiting, also for a host that has fallen silent.
        """
        self._test = _MotorTest(channel, pulse_us, self._clock() + seconds_ns(seconds))
        self.armed, self.pulses = False, self._neutral
        return self._command(self._continue_number(packet))

    def step(self) -> list[ThrusterCommand]:
        """What a test that runs commands now: the same again, so that the watchdog waits, or its end."""
        if self._test is None or self._clock() < self.wake_ns:
            return []
        if self._clock() >= self._test.ends_ns:
            self._end_test()
        return [self._command(self._sequence + 1)]

    def postpone(self, now_ns: int) -> None:
        """`wake_ns` has passed and nobody has called `step`: the next try."""
        self.wake_ns = now_ns + TEST_REPEAT_NS

    def reported(self, told: ThrusterTelemetry) -> None:
        """The STM32 has the last word on what holds: it may have refused a command, or tripped its watchdog."""
        if told.timed_out:
            self._end_test()
        if self._test is None:
            self.armed, self.pulses = told.armed, list(told.pwm_us)

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
        """The command's number: on by as much as the packet's is, back if the packet was overtaken."""
        number, commander = packet.get_seq(), sender(packet)
        step = (number - self._number + 128 & 0xFF) - 128 if commander == self._commander else 1
        self._number, self._commander = number, commander
        return self._sequence + step
