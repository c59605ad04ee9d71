"""Functions of one end of a frame link: keep-alives, and finding the command that a report answers."""

from hil.links.contract import (
    PWM_MAX_US,
    PWM_MIN_US,
    PWM_NEUTRAL_US,
    SentCommands,
    ThrusterCommand,
    ThrusterTelemetry,
)
from hil.links.frame.forms import Form
from hil.links.frame.layout import Other

NO_PULSE_US = 0


class KeepAlive:
    """A constant message, sent every period of its `rule`: always, or only while nothing else is sent.

    The second kind is checked twice a period, so that no pause is longer than one period.
    """

    def __init__(self, rule: Other, data: bytes) -> None:
        self._data, self._only_when_silent = data, rule.when_silent
        self._interval_ns = round((rule.period or 0.0) * (0.5e9 if rule.when_silent else 1e9))
        self.due_ns = 0
        self.is_needless = False  # something was sent since the last check

    def tick(self, now_ns: int) -> bytes:
        """Return the bytes to send at `now_ns` (monotonic)."""
        if now_ns < self.due_ns:
            return b""
        late_ns = now_ns - self.due_ns
        self.due_ns = now_ns + self._interval_ns - (late_ns if late_ns < self._interval_ns else 0)
        is_due = not (self._only_when_silent and self.is_needless)
        self.is_needless = is_due  # the keep-alive itself counts as sent
        return self._data if is_due else b""


class Echo:
    """Find the command that a report answers, where the frame carries less than 16 bits of the sequence number.

    With some `bits` it is the last sent command whose sequence number ends in them. With none it is found by its pulse
    widths.
    """

    def __init__(self, command: Form, report: Form, bits: int) -> None:
        self._command, self._report = command, report
        self._mask = (1 << bits) - 1
        self._sent = SentCommands()
        self._last = 0

    def add_command(self, command: ThrusterCommand) -> None:
        """Record a command that is sent."""
        self._last = command.sequence
        if not self._mask:
            self._sent.add_sent(self._reported_pulses(command), command.sequence)

    def answering(self, report: ThrusterTelemetry) -> ThrusterTelemetry:
        """Return the report with the sequence number of the command that it answers."""
        if self._mask:
            return report._replace(sequence=self._last - ((self._last - report.sequence) & self._mask) & 0xFFFF)
        return report._replace(sequence=self._sent.match(report.pwm_us))

    def _reported_pulses(self, command: ThrusterCommand) -> tuple[int, ...]:
        """Return the pulse widths that an STM32 would report for `command`, as both messages round them."""
        received = _crossed(self._command, command)
        widths = received.pwm_us if received.armed else (PWM_NEUTRAL_US,) * self._command.channels
        pulses = tuple([width if PWM_MIN_US <= width <= PWM_MAX_US else NO_PULSE_US for width in widths])
        return _crossed(self._report, ThrusterTelemetry(0, received.armed, False, pulses, 0, 0, 0, 0)).pwm_us


def _crossed(form: Form, message: ThrusterCommand | ThrusterTelemetry) -> ThrusterCommand | ThrusterTelemetry:
    """Return `message` as the other end decodes it."""
    received = form.body.message(form.body.packer.unpack(form.body.pack(message)))
    assert received, "what we pack is valid"
    return received
