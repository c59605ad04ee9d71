"""Device end (STM32) of thrusters on DroneCAN; `hil.links.dronecan.link` describes the messages."""

from hil.links.can_thrusters import SPAN_US, WRAP, deflection, propeller_load
from hil.links.contract import PWM_NEUTRAL_US, Message, ThrusterCommand, ThrusterTelemetry
from hil.links.dronecan import types
from hil.links.dronecan.node import PRIORITY_MEDIUM, DroneCanNode
from hil.links.dronecan.settings import ARMED, SOFTWARE, TIMED_OUT, TRIPS_SHIFT, DeviceSettings
from hil.links.dronecan.transfer import Transfer


class DroneCanDevice(DroneCanNode):
    """Device end."""

    def __init__(self, channels: int, settings: DeviceSettings) -> None:
        super().__init__(settings.node_id, types.NodeInfo("org.uuv-hil.stm32", settings.unique_bytes, SOFTWARE, (1, 0)))
        self._channels = channels
        self._neutral = (PWM_NEUTRAL_US,) * channels
        self._rpm_per_us = settings.full_rpm / SPAN_US
        self._require_arming = settings.require_arming
        self._first = settings.esc_index
        self._armed = not self._require_arming
        self._listen(types.RAW_COMMAND, types.unpack_raw_command, self._on_command)
        self._listen(types.ARMING_STATUS, types.unpack_arming_status, self._on_arming)

    def encode(self, message: Message) -> bytes:
        """Return a report as one esc.Status a thruster, after NodeStatus if that changes; encodes reports only."""
        assert isinstance(message, ThrusterTelemetry)
        code = message.watchdog_trips << TRIPS_SHIFT & WRAP | message.timed_out * TIMED_OUT | message.armed * ARMED
        output = []
        if code != self.vendor_code:
            self.vendor_code = code
            self.health = types.HEALTH_WARNING if message.timed_out else types.HEALTH_OK
            output.append(self._status())
        for index, pulse in enumerate(message.pwm_us):
            status = types.pack_esc_status(self._esc_status(index, pulse, message.errors))
            output.append(self._broadcast(types.ESC_STATUS, PRIORITY_MEDIUM, status))
        return b"".join(output)

    def _esc_status(self, index: int, pulse: int, errors: int) -> types.EscStatus:
        microseconds = deflection(pulse)
        values = propeller_load(index, pulse)
        percent = round(100 * abs(microseconds / SPAN_US) ** 3)  # power goes with the cube of speed
        return types.EscStatus(errors, *values, round(microseconds * self._rpm_per_us), percent, index + self._first)

    def _on_command(self, _: Transfer, raw: list[int]) -> ThrusterCommand:
        """Return the command; thrusters beyond the number in it stop."""
        ours = raw[self._first : self._first + self._channels]
        pulses = [PWM_NEUTRAL_US + round(value * SPAN_US / types.FULL_RAW) for value in ours]
        return ThrusterCommand(0, self._armed, (*pulses, *self._neutral[len(pulses) :]))

    def _on_arming(self, _: Transfer, status: int) -> ThrusterCommand | None:
        was_armed = self._armed
        self._armed = status == types.FULLY_ARMED or not self._require_arming
        return ThrusterCommand(0, False, self._neutral) if was_armed and not self._armed else None
