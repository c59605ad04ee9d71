"""VESC protocol of a thruster link: thrusters on VESC motor controllers, in their own CAN protocol.

Source: github.com/vedderb/bldc, documentation/comm_can.md and comm/comm_can.c. An identifier of 29 bits is
command << 8 | controller; a command takes one frame, with one big-endian int32. Thruster i is controller
`first_id` + i.

    SET_DUTY         0   duty x 100 000         STATUS     9   ERPM i32, current x 10 i16, duty x 1000 i16
    SET_CURRENT      1   A x 1000               STATUS_4  16   two temperatures x 10, input current x 10, position
    SET_RPM          3   ERPM x 1               STATUS_5  27   tachometer (6 a turn of the field), volts x 10
    SET_CURRENT_REL 10   fraction x 100 000     PING 17, PONG 18

(In the document's table SET_RPM is in 1/1000; its own example and the firmware take whole ERPM.)

1100 to 1900 us are -1 to +1 of the quantity that `command` chooses, exact to 1 us; values beyond are limited. "No
pulse", and all thrusters if not armed, are sent as SET_CURRENT 0: it releases the motor, whereas duty 0 brakes it.

The device acts as all controllers. It combines their commands into one ThrusterCommand when it has one for each, or
earlier when one controller gets a second one. In that case thrusters without a command continue as a VESC would, for
0.5 s, and are then released. If all are released, the command is disarmed. It sends STATUS of each for each report,
STATUS_4 and STATUS_5 every `status_period`. Its duty gives the exact pulse width; with real controllers that control
the speed (`rpm`) the host uses ERPM instead.

A status carries no sequence number, arming or timeout, so the host infers them from what it has sent. `timed_out` means
a neutral report after a report of a non-neutral command, if nothing neutral was sent; a timeout while neutral cannot be
detected. `age_us` and `errors` are 0.
"""

from typing import Any

from hil.common.errors import ConfigError
from hil.common.schema import parse
from hil.links.contract import MAX_THRUSTERS, Protocol
from hil.links.protocols import Role
from hil.links.vesc.device import VescDevice
from hil.links.vesc.end import EVERY_ID, VescSettings
from hil.links.vesc.host import VescHost


def open_vesc(role: Role, channels: int, **settings: Any) -> Protocol:
    """Return one end's protocol. `settings` are those of VescSettings, and the device's hooks `motor_values`, `clock`.

    Raises ConfigError if a setting is wrong or there are too many thrusters for a link.
    """
    if not 0 < channels <= MAX_THRUSTERS:
        raise ConfigError(f"protocol vesc: carries 1 to {MAX_THRUSTERS} thrusters, not {channels}")
    hooks = {name: settings.pop(name) for name in ("motor_values", "clock") if name in settings}
    own = parse(settings, VescSettings, "protocol vesc")
    if own.first_id + channels > EVERY_ID:
        raise ConfigError(f"protocol vesc: first_id {own.first_id} leaves no room for {channels}; 254 is the last")
    return VescHost(channels, own) if role == "host" else VescDevice(channels, own, **hooks)
