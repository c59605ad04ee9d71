"""Host end (vehicle's computer) of a MAVLink thruster link: send commands, receive reports."""

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.links.contract import PWM_NEUTRAL_US, Message, SentCommands, ThrusterCommand, ThrusterTelemetry
from hil.links.mavlink import end
from hil.links.mavlink.end import MavlinkEnd
from hil.links.mavlink.reports import encode_host_heartbeat
from hil.links.mavlink.servos import ServoOutputRaw
from hil.links.mavlink.settings import MavlinkSettings

OVERTAKEN = 16  # packets by which one may be overtaken, as on UDP; an older one comes from a restarted device
OVERTAKEN_US = 1_000_000  # the same as time of the device's clock
NOT_A_PULSE_US = 1  # for RC_CHANNELS_OVERRIDE, where 0 releases the channel
IGNORED = 0xFFFF  # in RC_CHANNELS_OVERRIDE: leave the channel unchanged


class MavlinkHost(MavlinkEnd):
    """Host end."""

    echoes_sequence = False

    def __init__(
        self, channels: int, settings: MavlinkSettings, clock: Callable[[], int], wall_clock: Callable[[], int]
    ) -> None:
        super().__init__(channels, settings, settings.host_component, clock, wall_clock)
        self._device = settings.system, settings.component
        self._encode_pulses = {
            "servo_output_raw": self.servo_output_raw,
            "rc_channels_override": self._rc_channels_override,
        }[settings.command]
        self._sent = SentCommands()
        self._answered = -1  # sequence number of the command in the last report
        self._shown_us = 0  # time of the first report with it, on the device's clock
        self._device_armed: bool | None = None  # None: unknown
        self._timed_out = False
        self._errors = self._trips = self._frames = 0
        self._status_number = 0  # sequence number of the packet with the newest SYS_STATUS, 0 to 255
        self._newest_us = 0  # time of the newest report, on the device's clock
        self._attempts = 0  # to arm or disarm, since the device last had the requested state
        self.handlers = {
            dialect.MAVLINK_MSG_ID_TIMESYNC: self.timesync,
            dialect.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            dialect.MAVLINK_MSG_ID_SYS_STATUS: self._sys_status,
            dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: self._report,
        }

    def encode(self, message: Message) -> bytes:
        """Return the packets of a command. Raises ValueError for another number of channels, or for a report."""
        if not isinstance(message, ThrusterCommand):
            raise ValueError("the host's end sends commands")
        self.check_channels(message.pwm_us)
        pulses = [PWM_NEUTRAL_US] * self.channels
        if message.armed:
            pulses = [width if end.is_pulse(width) else end.NO_PULSE_US for width in message.pwm_us]
        self._sent.add_sent(tuple(pulses), message.sequence)
        return self._arming(message.armed) + self._encode_pulses(pulses)

    def encode_settled(self, message: Message) -> bytes:
        """Return the packets of a command for a device in the same armed state, so without COMPONENT_ARM_DISARM."""
        self._device_armed = isinstance(message, ThrusterCommand) and message.armed
        return self.encode(message)

    def tick(self, now_ns: int) -> bytes:
        """Return the heartbeat of an onboard controller if it is due."""
        self.deadline_ns = end.next_due(self.deadline_ns, end.BEAT_NS, now_ns)
        return self.pack(encode_host_heartbeat())

    def _rc_channels_override(self, pulses: list[int]) -> bytes:
        channels = [width or NOT_A_PULSE_US for width in pulses] + [IGNORED] * (18 - len(pulses))
        return self.pack(dialect.MAVLink_rc_channels_override_message(*self._device, *channels))

    def _arming(self, armed: bool) -> bytes:
        """Return COMPONENT_ARM_DISARM, unless the device's last HEARTBEAT has the same armed state."""
        if armed == self._device_armed:
            self._attempts = 0
            return b""
        arm = dialect.MAVLink_command_long_message(
            *self._device,
            dialect.MAV_CMD_COMPONENT_ARM_DISARM,
            confirmation=min(self._attempts, 255),
            param1=float(armed),
            **{f"param{i}": 0.0 for i in range(2, 8)},
        )
        self._attempts += 1
        return self.pack(arm)

    def _heartbeat(self, packet: Any) -> None:
        if end.sender(packet) == self._device:
            self._device_armed = packet.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED != 0
            self._timed_out = packet.system_status == dialect.MAV_STATE_CRITICAL

    def _sys_status(self, packet: Any) -> None:
        behind = (self._status_number - packet.get_seq()) & 0xFF
        if end.sender(packet) == self._device and not 0 < behind <= OVERTAKEN:
            self._status_number = packet.get_seq()
            self._errors, self._trips, self._frames = packet.errors_comm, packet.errors_count1, packet.errors_count2

    def _report(self, packet: ServoOutputRaw) -> ThrusterTelemetry | None:
        if end.sender(packet) != self._device or packet.port != end.PORT:
            return None
        if 0 < (self._newest_us - packet.time_usec & end.U32) < OVERTAKEN_US:
            return None  # a newer one was received first
        self._newest_us = packet.time_usec
        pulses = packet.pulses[: self.channels]
        sequence = self._sent.match(pulses)
        return ThrusterTelemetry(
            sequence=sequence,
            armed=bool(self._device_armed),
            timed_out=self._timed_out,
            pwm_us=pulses,
            age_us=self._age_us(sequence, packet.time_usec),
            frames=self._frames,
            errors=self._errors,
            watchdog_trips=self._trips,
        )

    def _age_us(self, sequence: int, device_us: int) -> int:
        """Return the time (us) since the first report that showed this command, on the device's clock."""
        if sequence != self._answered:
            self._answered, self._shown_us = sequence, device_us
        return device_us - self._shown_us & end.U32
