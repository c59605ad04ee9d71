"""Device end (STM32) of thrusters on VESC controllers; `hil.links.vesc.link` describes the protocol."""

from collections.abc import Callable

from hil.common.clock import NS_PER_S, now_ns
from hil.links.can_thrusters import SPAN_US, MotorHook, deflection, propeller_load
from hil.links.contract import PWM_NEUTRAL_US, Message, ThrusterCommand, ThrusterTelemetry
from hil.links.vesc import end
from hil.links.vesc.end import VescProtocol, VescSettings
from hil.links.wires.can_frame import CanFrame, pack_frame

KELVIN = 273.15
NS_PER_MIN = 60 * NS_PER_S


def _int16(value: float) -> int:
    return min(max(int(value), -0x8000), 0x7FFF)  # truncated, as in the VESC firmware


class VescDevice(VescProtocol):
    """Device end, which acts as all controllers at once. `motor_values` returns the values that they measure.

    `clock` (monotonic, ns) gives the receive time of commands; it is the clock of `tick`.
    """

    def __init__(
        self,
        channels: int,
        settings: VescSettings,
        motor_values: MotorHook = propeller_load,
        clock: Callable[[], int] = now_ns,
    ) -> None:
        super().__init__(channels, settings)
        self._clock = clock
        self._us = {command: SPAN_US / full for command, full in self._full.items()}
        self._motor_values = motor_values
        self._waiting: dict[int, int] = {}  # thruster -> pulse width (us); 0 means released
        self._held = [0] * channels
        self._received_ns = [0] * channels
        self._now_ns = 0  # receive time of the present frames
        self._period_ns = round(settings.status_period * NS_PER_S)
        self._pulses: tuple[int, ...] = (PWM_NEUTRAL_US,) * channels
        self._tachometers = [0.0] * channels
        self._turned_ns = -1
        self._replies: list[bytes] = []
        self.deadline_ns = 0

    def feed(self, data: bytes) -> list[Message]:
        """Return the commands completed by whole records of CAN frames, received just now. Never raises."""
        self._now_ns = self._clock()
        return super().feed(data)

    def encode(self, message: Message) -> bytes:
        """Return a report as one STATUS for each thruster; encodes reports only."""
        assert isinstance(message, ThrusterTelemetry)
        self._pulses = message.pwm_us
        return b"".join([self._status(thruster, pulse) for thruster, pulse in enumerate(message.pwm_us)])

    def replies(self) -> bytes:
        """Return the answers to PING since the last call."""
        output = b"".join(self._replies)
        self._replies.clear()
        return output

    def tick(self, now_ns: int) -> bytes:
        """Return STATUS_4 and STATUS_5 of each thruster, if they are due."""
        if now_ns < self.deadline_ns:
            return b""
        self.deadline_ns = now_ns + self._period_ns
        self._advance_motors(now_ns)
        return b"".join([self._slow_status(thruster, pulse) for thruster, pulse in enumerate(self._pulses)])

    def _on_frame(self, command: int, controller: int, data: bytes) -> list[Message]:
        thruster = controller - self._settings.first_id
        addressed = range(self._channels) if controller == end.EVERY_ID else (thruster,)
        if addressed[0] not in range(self._channels):
            return []
        if command == end.PING:
            self._answer(addressed, data)
            return []
        pulse = self._pulse(command, data)
        if pulse is None:
            self.counters.malformed += 1
            return []
        return [message for each in addressed for message in self._set_thruster(each, pulse)]

    def _pulse(self, command: int, data: bytes) -> int | None:
        """Return the pulse width (us) of a command, 0 to release the motor; None if the command is not supported."""
        if len(data) < end.ARGUMENT.size:
            return None
        argument: int = end.ARGUMENT.unpack_from(data)[0]
        if command == end.SET_CURRENT:
            return None if argument else 0
        us = self._us.get(command)
        if us is None:
            return None
        return PWM_NEUTRAL_US + round(min(max(argument * us, -SPAN_US), SPAN_US))

    def _set_thruster(self, thruster: int, pulse: int) -> list[ThrusterCommand]:
        applied = [self._apply()] if thruster in self._waiting else []
        self._waiting[thruster] = pulse
        self._received_ns[thruster] = self._now_ns
        if len(self._waiting) == self._channels:
            applied.append(self._apply())
        return applied

    def _apply(self) -> ThrusterCommand:
        """Return one command made from all that were received since the last."""
        for thruster in range(self._channels):
            late = self._now_ns - self._received_ns[thruster] > end.TIMEOUT_NS
            self._held[thruster] = self._waiting.get(thruster, 0 if late else self._held[thruster])
        self._waiting.clear()
        if any(self._held):
            return ThrusterCommand(0, True, tuple(self._held))
        return ThrusterCommand(0, False, (PWM_NEUTRAL_US,) * self._channels)

    def _answer(self, thrusters: range | tuple[int, ...], data: bytes) -> None:
        if not data:
            self.counters.malformed += 1
            return
        for thruster in thrusters:
            answer = bytes((self._settings.first_id + thruster, end.HW_TYPE_VESC))
            self._replies.append(pack_frame(CanFrame(end.PONG << 8 | data[0], answer)))

    def _status(self, thruster: int, pulse: int) -> bytes:
        fraction = deflection(pulse) / SPAN_US
        current = self._motor_values(thruster, pulse).current_a
        erpm = round(fraction * self._settings.full_erpm)
        return self._frame(
            end.STATUS,
            thruster,
            end.STATUS_DATA.pack(erpm, _int16(current * 10), _int16(fraction * end.FULL_STATUS_DUTY)),
        )

    def _slow_status(self, thruster: int, pulse: int) -> bytes:
        values = self._motor_values(thruster, pulse)
        celsius = _int16((values.temperature_k - KELVIN) * 10)
        tachometer = (int(self._tachometers[thruster]) + 0x8000_0000 & 0xFFFF_FFFF) - 0x8000_0000
        status_4 = end.STATUS_4_DATA.pack(celsius, celsius, _int16(values.current_a * 10), 0)
        status_5 = end.STATUS_5_DATA.pack(tachometer, _int16(values.voltage_v * 10), 0)
        return self._frame(end.STATUS_4, thruster, status_4) + self._frame(end.STATUS_5, thruster, status_5)

    def _advance_motors(self, now_ns: int) -> None:
        """Advance the motors' positions to `now_ns`, at the speed of their pulse widths."""
        minutes = (now_ns - self._turned_ns) / NS_PER_MIN if self._turned_ns >= 0 else 0.0
        self._turned_ns = now_ns
        per_us = 6 * self._settings.full_erpm / SPAN_US
        for thruster, pulse in enumerate(self._pulses[: self._channels]):
            self._tachometers[thruster] += deflection(pulse) * per_us * minutes
