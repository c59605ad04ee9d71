"""MAVLink 2 protocol of a thruster link, for thruster controllers and flight controllers that support it.

Messages (mavlink.io/en/messages/common.html and ardupilotmega.html):

    host -> device   SERVO_OUTPUT_RAW        pulse widths in us, port 0               `command` chooses
                     RC_CHANNELS_OVERRIDE    pulse widths in us                       one of these
                     COMMAND_LONG            COMPONENT_ARM_DISARM
                     HEARTBEAT               1 Hz: an onboard controller
    device -> host   SERVO_OUTPUT_RAW        the pulse widths in effect, one report a command
                     HEARTBEAT, SYS_STATUS   1 Hz, and ahead of the report when armed or timed out change

The device also executes DO_SET_SERVO, and acknowledges each COMMAND_LONG, see `hil.links.mavlink.device`. Both ends
answer TIMESYNC. Messages for other addresses are ignored.

Arming. Neither of the two carries it. So the host sends COMPONENT_ARM_DISARM before each
command while the device's HEARTBEAT differs; the two then agree again after a lost message or a watchdog trip. A
command that is not armed carries neutral pulse widths.

Telemetry at the host. `pwm_us`, `armed`, `timed_out` and `watchdog_trips` are those at the time of the report:
HEARTBEAT (base_mode SAFETY_ARMED; system_status CRITICAL after a watchdog trip) and SYS_STATUS (errors_count1: watchdog
trips) are sent before a report with a change. `errors` (errors_comm) and `frames` (errors_count2) are up to 1 s old. No
message returns the command's sequence number: `sequence` is inferred from the pulse widths, see `SentCommands`, and
`age_us` counts, on the device's clock, from the first report with them. At the device, the packet's own 8-bit number,
extended to 16 bits, is the command's sequence number, so that an overtaken command is detected.

Only MAVLink 2 is read; a MAVLink 1 packet counts as noise, and so does a message that is not in the dialect,
because its checksum depends on the unknown layout. The dialect is ardupilotmega, as for the gateway, which needs its
ESC_TELEMETRY: `common` would save 1.6 of 11.8 MiB and 4 of 27 ms. pymavlink's mavutil (120 ms, and numpy) is not used.
"""

import time
from collections.abc import Callable
from typing import Any

from hil.common.clock import now_ns
from hil.common.errors import ConfigError, MissingExtraError
from hil.common.schema import parse
from hil.links.contract import MAX_THRUSTERS, Protocol
from hil.links.mavlink.settings import MavlinkSettings
from hil.links.protocols import Role


def open_mavlink(
    role: Role,
    channels: int,
    clock: Callable[[], int] = now_ns,
    wall_clock: Callable[[], int] = time.time_ns,
    **settings: Any,
) -> Protocol:
    """Return one end of a MAVLink thruster link for 1 to 16 thrusters; `settings` are those of `MavlinkSettings`.

    `clock` (monotonic, ns) stamps reports; it is the clock of `tick`. `wall_clock` (ns since
    1970) gives the first signature its timestamp. Raises ConfigError; MissingExtraError without pymavlink.
    """
    agreed = parse(settings, MavlinkSettings, "mavlink")
    if not 1 <= channels <= MAX_THRUSTERS:
        raise ConfigError(f"mavlink carries 1 to {MAX_THRUSTERS} thrusters, not {channels}")
    try:
        from hil.links.mavlink.device import MavlinkDevice
        from hil.links.mavlink.host import MavlinkHost
    except ImportError as error:
        if (error.name or "").partition(".")[0] != "pymavlink":
            raise
        raise MissingExtraError("MAVLink needs pymavlink: pip install 'uuv-hil[mavlink]'") from None
    return (MavlinkHost if role == "host" else MavlinkDevice)(channels, agreed, clock, wall_clock)
