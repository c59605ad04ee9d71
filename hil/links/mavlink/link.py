"""Thruster messages as MAVLink 2, for a thruster controller or a flight board that speaks it.

Which message says what (mavlink.io/en/messages/common.html and ardupilotmega.html):

    host -> device   SERVO_OUTPUT_RAW        pulse widths in us, port 0               `command` chooses
                     HIL_ACTUATOR_CONTROLS   -1..1 and an armed flag; nan is no pulse    one of these
                     RC_CHANNELS_OVERRIDE    pulse widths in us                          three
                     COMMAND_LONG            COMPONENT_ARM_DISARM
                     HEARTBEAT               1 Hz: an onboard controller
    device -> host   SERVO_OUTPUT_RAW        the pulse widths in effect, one report a command
                     HEARTBEAT, SYS_STATUS   1 Hz, and ahead of the report when armed or timed out change
                     ESC_TELEMETRY_n_TO_m    5 Hz, if the device has readings of its ESCs

The device also obeys what a ground station may send it: MANUAL_CONTROL and, as COMMAND_LONG, DO_SET_SERVO,
DO_MOTOR_TEST and REQUEST_MESSAGE; each COMMAND_LONG is acknowledged, see `hil.links.mavlink.device`. Both
ends answer TIMESYNC. Messages for someone else are passed over.

Armed. SERVO_OUTPUT_RAW and RC_CHANNELS_OVERRIDE do not say it: the host puts COMPONENT_ARM_DISARM before a
command as long as the device's HEARTBEAT disagrees, so that neither a lost message nor a watchdog trip leaves the
two apart. HIL_ACTUATOR_CONTROLS says it in each message. A command that is not armed carries neutral pulses.

What the host hears, and when. `pwm_us`, `armed`, `timed_out` and `watchdog_trips` are those of the report's own
instant: HEARTBEAT (base_mode SAFETY_ARMED; system_status CRITICAL after a watchdog trip) and SYS_STATUS
(errors_count1: watchdog trips) go ahead of the report that shows a change. `errors` (errors_comm) and `frames`
(errors_count2) are up to 1 s old. No message carries the command's number back: `sequence` is inferred from the
pulses, see `SentCommands`, and `age_us` counts, on the device's clock, from the first report that shows them.
Towards the device the packet's own 8-bit number, continued to 16, is the command's: one that was overtaken is seen
to be late.

Only MAVLink 2 is read; a MAVLink 1 packet counts as noise, and so does a message that the dialect does not know,
because its checksum depends on the unknown layout. The dialect is ardupilotmega, the smallest that has
ESC_TELEMETRY: `common` would save 1.6 of 11.8 MiB and 4 of 27 ms. pymavlink's mavutil (120 ms, and numpy) is
not used.
"""

import time
from collections.abc import Callable
from typing import Annotated, Any, Literal, NamedTuple

from hil.clock import now_ns
from hil.errors import ConfigError, MissingExtraError
from hil.links.contract import MAX_THRUSTERS, Protocol
from hil.links.protocols import Role
from hil.schema import Range, parse

Id = Annotated[int, Range(1, 255)]


class MavlinkSettings(NamedTuple):
    """What both ends have to agree on; `command` concerns the host alone, `mix` the device alone.

    system, component: the device's ids; the host is `host_component` of the same system (191: onboard computer).
    Messages without an address are obeyed only within that system.
    span_us: how far from neutral +-1 (HIL_ACTUATOR_CONTROLS, MANUAL_CONTROL) and 0 and 100 % (DO_MOTOR_TEST) lie;
    400 us is what Blue Robotics' Basic ESC takes for full thrust and ArduSub's default.
    mix: one row a thruster for MANUAL_CONTROL: its share (-1..1) of forward, right, up and yaw to the right.
    signing_key: 64 hexadecimal digits, or a passphrase whose SHA-256 is the key; empty: packets are not signed.
    """

    command: Literal["servo_output_raw", "hil_actuator_controls", "rc_channels_override"] = "servo_output_raw"
    system: Id = 1
    component: Id = 1
    host_component: Id = 191
    span_us: Annotated[int, Range(1, 700)] = 400
    mix: tuple[tuple[float, float, float, float], ...] = ()
    signing_key: str = ""

    def problem(self) -> str | None:
        """Two components cannot share an id."""
        return "component and host_component are the same" if self.component == self.host_component else None


class EscReading(NamedTuple):
    """What one ESC measures. On the wire each is a whole number without sign, of the unit in brackets."""

    speed: float  # rad/s, its magnitude (rpm)
    voltage: float  # V (0.01)
    current: float  # A (0.01)
    temperature: float  # degC (1)
    charge: float  # A s consumed since power-up (mA h)


def open_mavlink(
    role: Role,
    channels: int,
    clock: Callable[[], int] = now_ns,
    wall_clock: Callable[[], int] = time.time_ns,
    **settings: Any,
) -> Protocol:
    """One end of a MAVLink thruster link for 1 to 16 thrusters; `settings` are those of `MavlinkSettings`.

    `clock` (monotonic, ns) stamps reports and times motor tests; it is the clock of `tick`. `wall_clock` (ns since
    1970) gives the first signature its timestamp. Raises ConfigError; MissingExtraError without pymavlink.
    """
    agreed = parse(settings, MavlinkSettings, "mavlink")
    if not 1 <= channels <= MAX_THRUSTERS:
        raise ConfigError(f"mavlink carries 1 to {MAX_THRUSTERS} thrusters, not {channels}")
    if agreed.mix and len(agreed.mix) != channels:
        raise ConfigError(f"mavlink: mix: has {len(agreed.mix)} rows for {channels} thrusters")
    try:
        from hil.links.mavlink.device import MavlinkDevice
        from hil.links.mavlink.host import MavlinkHost
    except ImportError as error:
        if (error.name or "").partition(".")[0] != "pymavlink":
            raise
        raise MissingExtraError("MAVLink needs pymavlink: pip install 'uuv-hil[mavlink]'") from None
    return (MavlinkHost if role == "host" else MavlinkDevice)(channels, agreed, clock, wall_clock)
