"""Device end (thruster controller) of a MAVLink thruster link; a host or a ground station commands it.

    SERVO_OUTPUT_RAW        all pulses; port 0, from a component of this system
    HIL_ACTUATOR_CONTROLS   all pulses, and whether armed; from a component of this system
    RC_CHANNELS_OVERRIDE    pulses of the channels that are not ignored; a released channel goes to neutral
    MANUAL_CONTROL          x forward, y right, r yaw to the right (-1000..1000), z up (0..1000, 500 neutral, as
                            ArduSub has it), mixed by `mix`; malformed without one. An axis of 32767 is neutral
    COMMAND_LONG            acknowledged, whatever it is:
      COMPONENT_ARM_DISARM  arming leaves the pulses as they are, which after disarming is neutral
      DO_SET_SERVO          one channel; rejected for the time being while disarmed
      DO_MOTOR_TEST         one channel for up to 30 s, armed or not; the others are neutral, and at the end all are,
                            disarmed. Per cent as in ArduSub: 0 full astern, 50 neutral, 100 full ahead. Without a
                            time it lasts 0.5 s, also as in ArduSub: the ground station repeats it. Any other
                            command ends the test
      REQUEST_MESSAGE       AUTOPILOT_VERSION, also by its old name REQUEST_AUTOPILOT_CAPABILITIES
    COMMAND_INT             acknowledged: COMMAND_LONG only
    PARAM_*, MISSION_*,     answered at once, with empty lists: see ground_station.py
    FILE_TRANSFER_PROTOCOL

Commands are accepted from any sender, and the last one wins; `signing_key` restricts that to senders with the key. A
command for some of the pulses leaves the others unchanged. All of these count as commands for the STM32's watchdog. A
motor test is repeated every 50 ms by `feed`, which therefore has to be called at `deadline_ns` even without data;
otherwise the watchdog ends the test.
"""

from collections.abc import Callable, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common.clock import NS_PER_S
from hil.links.contract import PWM_NEUTRAL_US, Message, ThrusterCommand, ThrusterTelemetry
from hil.links.mavlink.end import (
    BEAT_NS,
    NO_PULSE_US,
    PORT,
    MavlinkEnd,
    is_pulse,
    next_due,
    sender,
    share_to_pulse,
)
from hil.links.mavlink.ground_station import GroundStationAnswers
from hil.links.mavlink.outputs import Outputs
from hil.links.mavlink.reports import (
    encode_autopilot_version,
    encode_device_heartbeat,
    encode_esc_telemetry,
    encode_sys_status,
)
from hil.links.mavlink.servos import ServoOutputRaw
from hil.links.mavlink.settings import EscReading, MavlinkSettings

ESC_PERIOD_NS = NS_PER_S // 5
TEST_LIMIT_S = 30.0  # ArduPilot's longest motor test
TEST_DEFAULT_S = 0.5
AXIS_INVALID = 0x7FFF
IGNORED = 0xFFFF

Result = tuple[int, ThrusterCommand | None]  # MAV_RESULT, and the command for the STM32


class MavlinkDevice(MavlinkEnd):
    """Device end. `esc`: measured values, one reading for each ESC; once set they are sent at 5 Hz."""

    def __init__(
        self, channels: int, settings: MavlinkSettings, clock: Callable[[], int], wall_clock: Callable[[], int]
    ) -> None:
        super().__init__(channels, settings, settings.component, clock, wall_clock)
        self.esc: Sequence[EscReading] = ()
        self._esc_count = 0
        self._beat_ns = self._esc_ns = 0
        self._reported = ThrusterTelemetry(0, False, False, (PWM_NEUTRAL_US,) * channels, 0, 0, 0, 0)
        self._outputs = Outputs(channels, clock)
        self.handlers = {
            dialect.MAVLINK_MSG_ID_TIMESYNC: self.timesync,
            dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: self._servo_output_raw,
            dialect.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS: self._hil_actuator_controls,
            dialect.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE: self._rc_channels_override,
            dialect.MAVLINK_MSG_ID_MANUAL_CONTROL: self._manual_control,
            dialect.MAVLINK_MSG_ID_COMMAND_LONG: self._command_long,
            dialect.MAVLINK_MSG_ID_COMMAND_INT: self._command_int,
        }
        self._answers = GroundStationAnswers(settings.system).handlers
        self.handlers |= dict.fromkeys(self._answers, self._answer_ground_station)
        self._commands: dict[int, Callable[[Any], Result]] = {
            dialect.MAV_CMD_COMPONENT_ARM_DISARM: self._arm_disarm,
            dialect.MAV_CMD_DO_SET_SERVO: self._set_servo,
            dialect.MAV_CMD_DO_MOTOR_TEST: self._motor_test,
            dialect.MAV_CMD_REQUEST_MESSAGE: self._request_message,
            dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: self._send_version,
        }

    def feed(self, data: bytes) -> list[Message]:
        """Return due commands of a motor test, and the commands that `data` completes. Never raises."""
        messages = [*self._outputs.step(), *super().feed(data)]
        self._schedule()
        return messages

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
        """Return heartbeat, status and ESC readings, each when it is due."""
        data = b""
        if now_ns >= self._beat_ns:
            self._beat_ns = next_due(self._beat_ns, BEAT_NS, now_ns)
            data += self._state()
        if now_ns >= self._esc_ns:
            self._esc_ns = next_due(self._esc_ns, ESC_PERIOD_NS, now_ns)
            self._esc_count += 1
            data += b"".join([self.pack(message) for message in encode_esc_telemetry(self.esc, self._esc_count)])
        if now_ns >= self._outputs.wake_ns:
            self._outputs.postpone(now_ns)
        self._schedule()
        return data

    def _schedule(self) -> None:
        self.deadline_ns = min(self._beat_ns, self._esc_ns, self._outputs.wake_ns)

    def _state(self) -> bytes:
        return self.pack(encode_device_heartbeat(self._reported)) + self.pack(encode_sys_status(self._reported))

    def _servo_output_raw(self, packet: ServoOutputRaw) -> ThrusterCommand | None:
        if packet.system != self.settings.system or packet.port != PORT:
            return None
        return self._outputs.set_pulses(packet.pulses[: self.channels], self._outputs.armed, packet)

    def _hil_actuator_controls(self, packet: Any) -> ThrusterCommand | None:
        if packet.get_srcSystem() != self.settings.system:
            return None
        armed = packet.mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED != 0
        return self._outputs.set_pulses(self._pulses(packet.controls[: self.channels]), armed, packet)

    def _rc_channels_override(self, packet: Any) -> ThrusterCommand | None:
        if not self._is_addressed_here(packet.target_system, packet.target_component):
            return None
        widths = [getattr(packet, f"chan{i}_raw") for i in range(1, self.channels + 1)]
        pulses = [_overridden(i, width, self._outputs.pulses[i]) for i, width in enumerate(widths)]
        return self._outputs.set_pulses(pulses, self._outputs.armed, packet)

    def _manual_control(self, packet: Any) -> ThrusterCommand | None:
        if not self._is_addressed_here(packet.target):
            return None
        if not self.settings.mix:
            self.counters.malformed += 1
            return None
        x, y, r = [0.0 if axis == AXIS_INVALID else axis / 1000 for axis in (packet.x, packet.y, packet.r)]
        z = 0.0 if packet.z == AXIS_INVALID else (max(0, min(packet.z, 1000)) - 500) / 500
        shares = [forward * x + right * y + up * z + yaw * r for forward, right, up, yaw in self.settings.mix]
        return self._outputs.set_pulses(self._pulses(shares), self._outputs.armed, packet)

    def _answer_ground_station(self, packet: Any) -> None:
        if self._is_addressed_here(packet.target_system, packet.target_component):
            for message in self._answers[packet.get_msgId()](packet):
                self.reply(message)

    def _command_int(self, packet: Any) -> None:
        if self._is_addressed_here(packet.target_system, packet.target_component):
            self._acknowledge(packet, dialect.MAV_RESULT_COMMAND_LONG_ONLY)

    def _command_long(self, packet: Any) -> ThrusterCommand | None:
        if not self._is_addressed_here(packet.target_system, packet.target_component):
            return None
        handle = self._commands.get(packet.command)
        result, command = handle(packet) if handle else (dialect.MAV_RESULT_UNSUPPORTED, None)
        self._acknowledge(packet, result)
        return command

    def _acknowledge(self, packet: Any, result: int) -> None:
        self.reply(dialect.MAVLink_command_ack_message(packet.command, result, 0, 0, *sender(packet)))

    def _arm_disarm(self, packet: Any) -> Result:
        if packet.param1 not in (0.0, 1.0):
            return dialect.MAV_RESULT_DENIED, None
        return dialect.MAV_RESULT_ACCEPTED, self._outputs.arm(packet.param1 == 1.0, packet)

    def _set_servo(self, packet: Any) -> Result:
        channel, width = self._channel(packet.param1), packet.param2
        if channel is None or not (is_pulse(width) or width == NO_PULSE_US):
            return dialect.MAV_RESULT_DENIED, None
        if not self._outputs.armed:
            return dialect.MAV_RESULT_TEMPORARILY_REJECTED, None
        pulses = self._outputs.change(channel, round(width))
        return dialect.MAV_RESULT_ACCEPTED, self._outputs.set_pulses(pulses, True, packet)

    def _motor_test(self, packet: Any) -> Result:
        channel = self._channel(packet.param1)
        pulse = self._test_pulse(packet.param2, packet.param3)
        seconds = packet.param4 or TEST_DEFAULT_S
        one_motor = packet.param5 in (0.0, 1.0)
        if channel is None or pulse is None or not 0.0 < seconds <= TEST_LIMIT_S or not one_motor:
            return dialect.MAV_RESULT_DENIED, None
        return dialect.MAV_RESULT_ACCEPTED, self._outputs.start_test(channel, pulse, seconds, packet)

    def _test_pulse(self, kind: float, throttle: float) -> int | None:
        if kind == dialect.MOTOR_TEST_THROTTLE_PERCENT and 0.0 <= throttle <= 100.0:
            return share_to_pulse((throttle - 50.0) / 50.0, self.settings.span_us)
        if kind == dialect.MOTOR_TEST_THROTTLE_PWM and is_pulse(throttle):
            return round(throttle)
        return None

    def _request_message(self, packet: Any) -> Result:
        if packet.param1 != dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            return dialect.MAV_RESULT_DENIED, None
        return self._send_version(packet)

    def _send_version(self, _: Any) -> Result:
        self.reply(encode_autopilot_version())
        return dialect.MAV_RESULT_ACCEPTED, None

    def _is_addressed_here(self, system: int, component: int = 0) -> bool:
        return system in (0, self.settings.system) and component in (0, self.component)

    def _channel(self, instance: float) -> int | None:
        """Return the index of a channel, which MAVLink counts from 1; None if it does not exist."""
        return int(instance) - 1 if 1 <= instance <= self.channels and instance == int(instance) else None

    def _pulses(self, shares: Sequence[float]) -> list[int]:
        return [share_to_pulse(share, self.settings.span_us) for share in shares]


def _overridden(channel: int, width: int, current_us: int) -> int:
    """Return a channel's pulse (us) after RC_CHANNELS_OVERRIDE, which encodes its first eight channels differently."""
    ignored, released = ((IGNORED,), 0) if channel < 8 else ((0, IGNORED), IGNORED - 1)
    if width in ignored:
        return current_us
    return PWM_NEUTRAL_US if width == released else width
