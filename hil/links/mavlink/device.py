"""Device end (thruster controller) of a MAVLink thruster link; a host or a script commands it.

    SERVO_OUTPUT_RAW        all pulses; port 0, from a component of this system
    RC_CHANNELS_OVERRIDE    pulses of the channels that are not ignored; a released channel goes to neutral
    COMMAND_LONG            acknowledged, whatever it is:
      COMPONENT_ARM_DISARM  arming leaves the pulses as they are, which after disarming is neutral
      DO_SET_SERVO          one channel; rejected for the time being while disarmed

Commands are accepted from any sender, and the last one wins; `signing_key` restricts that to senders with the key. A
command for some of the pulses leaves the others unchanged. All of these count as commands for the STM32's watchdog.
Joysticks, motor tests, parameters and missions of ground stations are the vehicle's: see hil.gateways.mavlink. The
firmware in C executes the same, without signatures.
"""

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.links.contract import PWM_NEUTRAL_US, Message, ThrusterCommand, ThrusterTelemetry
from hil.links.mavlink import end
from hil.links.mavlink.end import MavlinkEnd
from hil.links.mavlink.outputs import Outputs
from hil.links.mavlink.reports import encode_device_heartbeat, encode_sys_status
from hil.links.mavlink.servos import ServoOutputRaw
from hil.links.mavlink.settings import MavlinkSettings

IGNORED = 0xFFFF

Result = tuple[int, ThrusterCommand | None]  # MAV_RESULT, and the command for the STM32


class MavlinkDevice(MavlinkEnd):
    """Device end."""

    def __init__(
        self, channels: int, settings: MavlinkSettings, clock: Callable[[], int], wall_clock: Callable[[], int]
    ) -> None:
        super().__init__(channels, settings, settings.component, clock, wall_clock)
        self._reported = ThrusterTelemetry(0, False, False, (PWM_NEUTRAL_US,) * channels, 0, 0, 0, 0)
        self._outputs = Outputs(channels)
        self.handlers = {
            dialect.MAVLINK_MSG_ID_TIMESYNC: self.timesync,
            dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: self._servo_output_raw,
            dialect.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE: self._rc_channels_override,
            dialect.MAVLINK_MSG_ID_COMMAND_LONG: self._command_long,
        }
        self._commands: dict[int, Callable[[Any], Result]] = {
            dialect.MAV_CMD_COMPONENT_ARM_DISARM: self._arm_disarm,
            dialect.MAV_CMD_DO_SET_SERVO: self._set_servo,
        }

    def encode(self, message: Message) -> bytes:
        """Return the packets of a report. Raises ValueError for another number of channels, or for a command."""
        if not isinstance(message, ThrusterTelemetry):
            raise ValueError("the device's end sends reports")
        self.check_channels(message.pwm_us)
        state = (message.armed, message.timed_out, message.watchdog_trips)
        changed = state != (self._reported.armed, self._reported.timed_out, self._reported.watchdog_trips)
        self._reported = message
        self._outputs.update_from_report(message)
        return (self._state() if changed else b"") + self.servo_output_raw(list(message.pwm_us))

    def tick(self, now_ns: int) -> bytes:
        """Return heartbeat and status, which are due."""
        self.deadline_ns = end.next_due(self.deadline_ns, end.BEAT_NS, now_ns)
        return self._state()

    def _state(self) -> bytes:
        return self.pack(encode_device_heartbeat(self._reported)) + self.pack(encode_sys_status(self._reported))

    def _servo_output_raw(self, packet: ServoOutputRaw) -> ThrusterCommand | None:
        if packet.system != self.settings.system or packet.port != end.PORT:
            return None
        return self._outputs.set_pulses(packet.pulses[: self.channels], self._outputs.armed, packet)

    def _rc_channels_override(self, packet: Any) -> ThrusterCommand | None:
        if not self._is_addressed_here(packet.target_system, packet.target_component):
            return None
        widths = [getattr(packet, f"chan{i}_raw") for i in range(1, self.channels + 1)]
        pulses = [_overridden(i, width, self._outputs.pulses[i]) for i, width in enumerate(widths)]
        return self._outputs.set_pulses(pulses, self._outputs.armed, packet)

    def _command_long(self, packet: Any) -> ThrusterCommand | None:
        if not self._is_addressed_here(packet.target_system, packet.target_component):
            return None
        handle = self._commands.get(packet.command)
        result, command = handle(packet) if handle else (dialect.MAV_RESULT_UNSUPPORTED, None)
        self.reply(dialect.MAVLink_command_ack_message(packet.command, result, 0, 0, *end.sender(packet)))
        return command

    def _arm_disarm(self, packet: Any) -> Result:
        if packet.param1 not in (0.0, 1.0):
            return dialect.MAV_RESULT_DENIED, None
        return dialect.MAV_RESULT_ACCEPTED, self._outputs.arm(packet.param1 == 1.0, packet)

    def _set_servo(self, packet: Any) -> Result:
        channel, width = self._channel(packet.param1), packet.param2
        if channel is None or not (end.is_pulse(width) or width == end.NO_PULSE_US):
            return dialect.MAV_RESULT_DENIED, None
        if not self._outputs.armed:
            return dialect.MAV_RESULT_TEMPORARILY_REJECTED, None
        pulses = self._outputs.change(channel, round(width))
        return dialect.MAV_RESULT_ACCEPTED, self._outputs.set_pulses(pulses, True, packet)

    def _is_addressed_here(self, system: int, component: int) -> bool:
        return system in (0, self.settings.system) and component in (0, self.component)

    def _channel(self, instance: float) -> int | None:
        """Return the index of a channel, which MAVLink counts from 1; None if it does not exist."""
        return int(instance) - 1 if 1 <= instance <= self.channels and instance == int(instance) else None


def _overridden(channel: int, width: int, current_us: int) -> int:
    """Return a channel's pulse (us) after RC_CHANNELS_OVERRIDE, which encodes its first eight channels differently."""
    ignored, released = ((IGNORED,), 0) if channel < 8 else ((0, IGNORED), IGNORED - 1)
    if width in ignored:
        return current_us
    return PWM_NEUTRAL_US if width == released else width
