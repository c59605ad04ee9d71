"""Host end (vehicle's computer) of thrusters on VESC controllers; `hil.links.vesc.link` describes the protocol."""

from typing import NamedTuple

from hil.links.can_thrusters import SPAN_US, WRAP, Answers, Rounds, has_output, pulse_at
from hil.links.contract import PWM_NEUTRAL_US, Message, ThrusterCommand, ThrusterTelemetry
from hil.links.vesc import end
from hil.links.vesc.end import VescProtocol, VescSettings


class Motor(NamedTuple):
    """Last values that a controller reported of its motor; zeros before."""

    erpm: int = 0
    current_a: float = 0.0
    duty: float = 0.0
    tachometer: int = 0
    voltage_v: float = 0.0


class VescHost(VescProtocol):
    """Host end. `motors` are the thrusters' last values."""

    echoes_sequence = False

    def __init__(self, channels: int, settings: VescSettings) -> None:
        super().__init__(channels, settings)
        self.motors = [Motor()] * channels
        self._command = end.COMMANDS[settings.command]
        self._per_us = self._full[self._command] / SPAN_US
        self._rounds = Rounds(channels)
        self._answers = Answers(channels)
        self._timed_out = False
        self._trips = 0

    def encode(self, message: Message) -> bytes:
        """Return a command as one frame for each thruster; encodes commands only."""
        assert isinstance(message, ThrusterCommand)
        requested = self._answers.record_command(message)
        output = []
        for thruster, pulse in enumerate(requested):
            if message.armed and has_output(message.pwm_us[thruster]):
                argument = end.ARGUMENT.pack(round((pulse - PWM_NEUTRAL_US) * self._per_us))
                output.append(self._frame(self._command, thruster, argument))
            else:
                output.append(self._frame(end.SET_CURRENT, thruster, end.ARGUMENT.pack(0)))
        return b"".join(output)

    def motor_values(self, thruster: int) -> dict[str, float]:
        """Return speed, current and voltage of a thruster's last reports."""
        motor = self.motors[thruster]
        return {"ERPM": motor.erpm, "A": motor.current_a, "V": motor.voltage_v}

    def _on_frame(self, command: int, controller: int, data: bytes) -> list[Message]:
        thruster = controller - self._settings.first_id
        if command not in (end.STATUS, end.STATUS_5) or not 0 <= thruster < self._channels:
            return []
        if len(data) < (6 if command == end.STATUS_5 else 8):  # older firmware omits the reserved bytes at the end
            self.counters.malformed += 1
            return []
        motor = self.motors[thruster]
        if command == end.STATUS_5:
            tachometer, volts, _ = end.STATUS_5_DATA.unpack(data[:6] + b"\0\0")
            self.motors[thruster] = motor._replace(tachometer=tachometer, voltage_v=volts / 10)
            return []
        return self._on_status(thruster, motor, data)

    def _on_status(self, thruster: int, motor: Motor, data: bytes) -> list[Message]:
        erpm, current, duty = end.STATUS_DATA.unpack(data)
        self.motors[thruster] = motor._replace(erpm=erpm, current_a=current / 10, duty=duty / end.FULL_STATUS_DUTY)
        by_speed = self._command == end.SET_RPM
        fraction = erpm / self._settings.full_erpm if by_speed else duty / end.FULL_STATUS_DUTY
        pulses = self._rounds.add_report(thruster, pulse_at(fraction * SPAN_US))
        return [] if pulses is None else [self._telemetry(pulses)]

    def _telemetry(self, pulses: tuple[int, ...]) -> ThrusterTelemetry:
        command = self._answers.find_command(pulses)
        stopped = all(pulse == PWM_NEUTRAL_US for pulse in pulses)
        timed_out = command.armed and stopped and command.pwm_us != pulses
        if timed_out and not self._timed_out:
            self._trips = (self._trips + 1) & WRAP
        self._timed_out = timed_out
        armed = command.armed and not timed_out
        return ThrusterTelemetry(command.sequence, armed, timed_out, pulses, 0, self._answers.frames, 0, self._trips)
