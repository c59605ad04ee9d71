"""Thrusters on DroneCAN: the host as a flight controller, the STM32 as a node that drives all thrusters.

    host    RawCommand (1030) for each command, ArmingStatus (1100) on change and twice a second, as ArduPilot does;
            with `allocate` also Allocation (1)
    device  esc.Status (1034) of each thruster for each report
    both    NodeStatus (341) once a second; the service GetNodeInfo (1)

Thruster i has the ESC index `esc_index` + i. An output of +-8191 is 1900 and 1100 us; values in between are exact to
1 us. Values beyond are limited. "No output" is sent as 0, "no rotation", as DroneCAN has nothing weaker. A disarmed
host sends zeros in addition to ArmingStatus 0, for controllers without arming.

The device applies ArmingStatus as AM32 motor controllers do (`require_arming`, true by default). Before FULLY_ARMED was
received, commands leave the outputs neutral. DISARMED stops the outputs at once. FULLY_ARMED alone starts nothing and
has no timeout of its own: a pause of RawCommand stops the outputs (AM32: 250 ms; here: the STM32's watchdog). A short
RawCommand stops the thrusters it leaves out; a longer one also addresses other controllers.

The rpm of a status gives the pulse width, proportional to `full_rpm` at 1900 us. Our device reports the commanded
value, exact to 1 us. Another device reports the true speed, which gives an approximate pulse width that matches no
command. Our device's NodeStatus, sent at once on change, has arming, timeouts and watchdog trips in `vendor_code`: bit
0 armed, bit 1 timed out, from bit 2 up the trips modulo 2^14. DroneCAN carries neither sequence number nor age: the
first is inferred, the second is 0.

Source of the AM32 behaviour: github.com/am32-firmware/AM32, Src/DroneCAN/DroneCAN.c.
"""

from typing import Any

from hil.common.errors import ConfigError
from hil.common.schema import parse
from hil.links.contract import MAX_THRUSTERS, Protocol
from hil.links.dronecan.device import DroneCanDevice
from hil.links.dronecan.host import DroneCanHost
from hil.links.dronecan.settings import MAX_ESCS, DeviceSettings, HostSettings
from hil.links.protocols import Role


def open_dronecan(role: Role, channels: int, **settings: Any) -> Protocol:
    """Return one end's protocol. `settings` are those of HostSettings or DeviceSettings.

    Raises ConfigError if a setting is wrong or there are too many thrusters for a link.
    """
    if not 0 < channels <= MAX_THRUSTERS:
        raise ConfigError(f"protocol dronecan: carries 1 to {MAX_THRUSTERS} thrusters, not {channels}")
    if role == "host":
        host = parse(settings, HostSettings, "protocol dronecan")
        _check_indices(host.esc_index, channels)
        return DroneCanHost(channels, host)
    device = parse(settings, DeviceSettings, "protocol dronecan")
    _check_indices(device.esc_index, channels)
    return DroneCanDevice(channels, device)


def _check_indices(first: int, channels: int) -> None:
    if first + channels > MAX_ESCS:
        raise ConfigError(
            f"protocol dronecan: esc_index: {channels} thrusters from {first} on go beyond the {MAX_ESCS} of a command"
        )
