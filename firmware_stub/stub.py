"""Specification of the STM32's behaviour in Python: PWM outputs, arming, watchdog, counters. No I/O, no clock.

Behaviour of the outputs:

    power-up    neutral (1500 us), disarmed
    command     applied if it has one pulse width per thruster and is not late. If its `armed` is set, the outputs
                get its pulse widths, otherwise neutral. One armed command arms the board
    watchdog    trips when no command was applied for `watchdog_ns`, armed or not: neutral, disarmed, `timed_out`,
                one trip counted, reported at once. The next command clears `timed_out`, and is applied

Sequence numbers: a command with the same number as the last is applied (a host without a counter always sends 0). A
number up to `LATE_WINDOW` below the last is late (an overtaken datagram), and refused. A lower one is from a host that
has restarted, and applied. After a watchdog trip any number is applied.
"""

from hil.common import clock
from hil.links.contract import (
    PWM_MAX_US,
    PWM_MIN_US,
    PWM_NEUTRAL_US,
    Message,
    ThrusterCommand,
    ThrusterLink,
    ThrusterTelemetry,
)

WATCHDOG_NS = 200_000_000  # four commands missed at 20 Hz, ten at 50 Hz
TELEMETRY_PERIOD_NS = 200_000_000  # a command is answered at once; more would fill a slow line
LATE_WINDOW = 32  # sequence numbers
NO_PULSE_US = 0
NEVER_US = 0xFFFF_FFFF  # age before the first command
WRAP = 0xFFFF  # sequence numbers and counters have 16 bits


class Stm32:
    """The STM32 board. `pwm_us` are the compare values of its PWM timers in microseconds, one per thruster.

    channels: number of thrusters, 1 to 16. watchdog_ns: the longest time without a command before the outputs go to
    neutral. telemetry_period_ns: the longest time between two reports. All times are nanoseconds of any monotonic clock
    that starts at 0 or above.

    Not modelled: the STM32's time for decoding, and the wait for the next PWM period (2.5 to 20 ms on a real board)
    until a new pulse width is on the pin.
    """

    def __init__(
        self, channels: int, watchdog_ns: int = WATCHDOG_NS, telemetry_period_ns: int = TELEMETRY_PERIOD_NS
    ) -> None:
        self.channels = channels
        self.watchdog_ns = watchdog_ns
        self.telemetry_period_ns = telemetry_period_ns
        self.pwm_us = [PWM_NEUTRAL_US] * channels
        self.armed = False
        self.timed_out = False
        self.sequence = 0  # number of the last applied command
        self.applied_ns = -1  # time of that command; -1: none
        self.frames = 0  # commands applied
        self.refused = 0  # commands with a wrong number of channels, or late
        self.line_errors = 0  # damaged frames; set by the reader of the line
        self.watchdog_trips = 0
        self._watchdog_due_ns = clock.NEVER_NS  # NEVER_NS: the watchdog has tripped, or was not started
        self._telemetry_due_ns = 0

    @property
    def deadline_ns(self) -> int:
        """Time (ns) at which `tick` must be called next, unless a command is received before."""
        return min(self._watchdog_due_ns, self._telemetry_due_ns)

    def command(self, command: ThrusterCommand, now_ns: int) -> bool:
        """Apply a command, or refuse it; return whether it was applied. A refused one does not reset the watchdog."""
        if len(command.pwm_us) != self.channels or self._is_late(command.sequence):
            self.refused += 1
            return False
        self.armed = command.armed
        self.pwm_us = _pulses(command.pwm_us) if command.armed else self._neutral()
        self.timed_out = False
        self.sequence = command.sequence & WRAP
        self.applied_ns = now_ns
        self.frames += 1
        self._watchdog_due_ns = now_ns + self.watchdog_ns
        return True

    def tick(self, now_ns: int) -> bool:
        """Advance the time, and trip the watchdog if it is due. Return whether telemetry is due."""
        if now_ns >= self._watchdog_due_ns:
            self.disarm()
            self.timed_out = True
            self.watchdog_trips += 1
            self._watchdog_due_ns = clock.NEVER_NS
            self._telemetry_due_ns = now_ns
        return now_ns >= self._telemetry_due_ns

    def telemetry(self, now_ns: int) -> ThrusterTelemetry:
        """Return the present telemetry. The next is due one period later; missed ones are skipped."""
        late_ns = now_ns - self._telemetry_due_ns
        on_time = 0 <= late_ns < self.telemetry_period_ns
        self._telemetry_due_ns = now_ns + self.telemetry_period_ns - (late_ns if on_time else 0)
        return ThrusterTelemetry(
            self.sequence,
            self.armed,
            self.timed_out,
            tuple(self.pwm_us),
            NEVER_US if self.applied_ns < 0 else min((now_ns - self.applied_ns) // 1000, NEVER_US),
            self.frames & WRAP,
            (self.refused + self.line_errors) & WRAP,
            self.watchdog_trips & WRAP,
        )

    def disarm(self) -> None:
        """Set all outputs to neutral, now."""
        self.armed = False
        self.pwm_us = self._neutral()

    def _neutral(self) -> list[int]:
        return [PWM_NEUTRAL_US] * self.channels

    def _is_late(self, sequence: int) -> bool:
        return self._watchdog_due_ns < clock.NEVER_NS and 0 < (self.sequence - sequence) & WRAP <= LATE_WINDOW


def _pulses(widths_us: tuple[int, ...]) -> list[int]:
    return [width if PWM_MIN_US <= width <= PWM_MAX_US else NO_PULSE_US for width in widths_us]


class Stm32End:
    """Device end of a link with an STM32: wait on `fileno()` until `deadline_ns`, then call `service`."""

    def __init__(self, stm32: Stm32, link: ThrusterLink) -> None:
        self.stm32 = stm32
        self.link = link
        self.wire = link.wire
        self.command_ns = 0  # monotonic time at which the outputs were last set by a command

    @property
    def deadline_ns(self) -> int:
        """Time (ns) at which `service` must be called even without data: for watchdog, telemetry, or the protocol."""
        return min(self.stm32.deadline_ns, self.link.protocol.deadline_ns)

    @property
    def pwm_us(self) -> list[int]:
        """Pulse widths in effect, us."""
        return self.stm32.pwm_us

    def fileno(self) -> int:
        """Return the descriptor to wait on for commands."""
        return self.link.wire.fileno()

    def service(self, now_ns: int) -> int:
        """Apply and answer the received commands, then advance the time; return how many were applied.

        Commands are read before the watchdog is checked. So the watchdog does not trip because this process was woken
        late. A command that was read before this process was stopped, for longer than the watchdog's time, is refused.
        Raises DeviceError when the wire is lost.
        """
        applied, read_ns = 0, clock.now_ns()
        for message in self.link.receive():
            if clock.now_ns() - read_ns > self.stm32.watchdog_ns:
                self.stm32.refused += 1
            elif self._apply(message, now_ns):
                self.command_ns = clock.now_ns()
                applied += 1
                self._report(now_ns)
        if self.stm32.tick(now_ns):
            self._report(now_ns)
        self.link.tick(now_ns)
        return applied

    def close(self) -> None:
        """Set the outputs to neutral and close the wire."""
        self.stm32.disarm()
        self.link.close()

    def _apply(self, message: Message, now_ns: int) -> bool:
        if isinstance(message, ThrusterCommand):
            return self.stm32.command(message, now_ns)
        self.link.counters.malformed += 1  # telemetry is sent here, not received
        return False

    def _report(self, now_ns: int) -> None:
        counters = self.link.counters
        self.stm32.line_errors = counters.checksum_errors + counters.malformed
        self.link.send(self.stm32.telemetry(now_ns))
