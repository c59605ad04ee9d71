"""Thrusters behind motor controllers on a CAN bus: the part that DroneCAN and VESC share.

Motor controllers take a signed fraction of full output instead of a pulse width: 1100, 1500 and 1900 us are -1, 0 and
+1, as on the Blue Robotics Basic ESC. Each controller reports on its own, without sequence number and arming: the host
infers both from the commands that it sent.
"""

from collections.abc import Callable
from typing import NamedTuple

from hil.links.contract import PWM_MAX_US, PWM_MIN_US, PWM_NEUTRAL_US, SentCommands, ThrusterCommand

SPAN_US = 400  # from neutral to full output
WRAP = 0xFFFF  # counters of the telemetry have 16 bits


class MotorValues(NamedTuple):
    """Measured values of one motor, except its speed."""

    voltage_v: float
    current_a: float
    temperature_k: float


# Returns the values of a thruster (number from 0) at a pulse width (us).
MotorHook = Callable[[int, int], MotorValues]


def propeller_load(_thruster: int, pulse_us: int) -> MotorValues:
    """Return simulated values of a motor, plausible for a thruster of the size of a T200 on 16 V.

    Speed is assumed proportional to the command, so power grows with its cube (propeller law). Full output draws 24 A
    and heats the electronics by 30 K above water of 288 K. Not modelled: supply voltage drop, dead band, time.
    """
    power = min(abs(deflection(pulse_us)) / SPAN_US, 1.0) ** 3
    return MotorValues(voltage_v=16.0, current_a=24.0 * power, temperature_k=288.0 + 30.0 * power)


def has_output(pulse_us: int) -> bool:
    """Return whether a pulse width (us) means an output, neutral included."""
    return PWM_MIN_US <= pulse_us <= PWM_MAX_US


def deflection(pulse_us: int) -> int:
    """Return the difference of a pulse width from neutral in us; 0 for a pulse width that means no output."""
    return pulse_us - PWM_NEUTRAL_US if has_output(pulse_us) else 0


def pulse_at(microseconds: float) -> int:
    """Return the pulse width (us) at this difference from neutral, limited to the valid range."""
    return min(max(PWM_NEUTRAL_US + round(microseconds), PWM_MIN_US), PWM_MAX_US)


def executable_pulses(command: ThrusterCommand) -> tuple[int, ...]:
    """Return the pulse widths (us) that motor controllers can apply: limited to full output, neutral for no output."""
    if not command.armed:
        return (PWM_NEUTRAL_US,) * len(command.pwm_us)
    low, high = -SPAN_US, SPAN_US
    return tuple([PWM_NEUTRAL_US + min(max(deflection(pulse), low), high) for pulse in command.pwm_us])


class Rounds:
    """Combine the reports of single motor controllers into one report of all thrusters.

    Controllers on one node report in turn, 0 to the last. A round is one such turn without a gap, so that a lost report
    loses its round but never mixes two. Separate controllers may report in any order: after `PATIENCE` rounds' worth of
    reports without a complete turn, a round is complete when it has at least one report of each.
    """

    PATIENCE = 3

    def __init__(self, channels: int) -> None:
        self._channels = channels
        self._pulses = [PWM_NEUTRAL_US] * channels
        self._missing = set(range(channels))  # thrusters without a report in this round
        self._next = 0  # thruster whose report is next in turn
        self._since_turn = 0  # reports since the last complete turn

    def add_report(self, thruster: int, pulse_us: int) -> tuple[int, ...] | None:
        """Add a thruster's report; return the pulse widths (us) of all thrusters if it completes a round, else None."""
        self._pulses[thruster] = pulse_us
        self._missing.discard(thruster)
        self._next = self._next + 1 if thruster == self._next else int(thruster == 0)
        self._since_turn += 1
        if self._next == self._channels:
            self._next = self._since_turn = 0
        elif self._missing or self._since_turn <= self.PATIENCE * self._channels:
            return None
        self._missing.update(range(self._channels))
        return tuple(self._pulses)


class Answers:
    """Find the command that a round of reports answers, and count the commands that were answered."""

    def __init__(self, channels: int) -> None:
        self.frames = 0  # commands that reports have confirmed
        self.answered = ThrusterCommand(0, False, (PWM_NEUTRAL_US,) * channels)
        self._sent = SentCommands()
        self._commands: dict[int, ThrusterCommand] = {}  # count of commands, the number in SentCommands -> command
        self._count = 0

    def record_command(self, command: ThrusterCommand) -> tuple[int, ...]:
        """Record a command that is sent; return the pulse widths (us) to send to the motor controllers."""
        requested = executable_pulses(command)
        self._count += 1
        self._sent.add_sent(requested, self._count)
        self._commands[self._count] = ThrusterCommand(command.sequence, command.armed, requested)
        self._commands.pop(self._count - SentCommands.DEPTH, None)
        return requested

    def find_command(self, pulses: tuple[int, ...]) -> ThrusterCommand:
        """Return the command that a round with these pulse widths (us) answers, with the pulse widths sent for it."""
        command = self._commands.get(self._sent.match(pulses))
        if command is not None and command is not self.answered:
            self.answered = command
            self.frames = (self.frames + 1) & WRAP
        return self.answered
