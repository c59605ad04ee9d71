"""Thrusters on DroneCAN: the host as a flight controller, the STM32 as a node that drives all thrusters.

    host    RawCommand (1030) for each command, ArmingStatus (1100) on change and twice a second, as ArduPilot
            or RPMCommand (1031), with `command = "rpm"`
    device  esc.Status (1034) of each thruster for each report, StatusExtended (1036) once a second, BatteryInfo (1092)
    both    NodeStatus (341) once a second, Allocation (1); the services GetNodeInfo (1), GetTransportStats (4),
            ExecuteOpcode (10), GetSet (11), RestartNode (5), which the host refuses

The device has the parameters CAN_NODE, ESC_INDEX, FULL_RPM and REQUIRE_ARMING. The first one holds from the next start
on. RestartNode stops the thrusters and begins as after power-up with what is stored; the board's counters go on.

Thruster i is `esc_index` i behind that of the first. An output of +-8191 is 1900 and 1100 us; in between it is exact to
1 us. What is beyond is clamped, and no pulse at all is 0, "no rotation", as DroneCAN has nothing weaker. A disarmed
host sends zeros besides ArmingStatus 0, for controllers without arming.

The device applies ArmingStatus as the motor controllers of AM32 do (REQUIRE_ARMING, 1 by default): without
FULLY_ARMED received, commands leave the outputs neutral; DISARMED ends them at once; FULLY_ARMED alone starts
nothing and has no time-out of its own: a pause of RawCommand ends all (AM32: 250 ms; here: the STM32's
watchdog). A RawCommand that is too short stops the thrusters it leaves out, a longer one is also for others.

The rpm of a status gives the pulse, in proportion to `full_rpm` at 1900 us: what our device reports is the
command, exact to 1 us; the true speed of another device gives an approximate pulse, which answers no command.
Arming, time-outs and trips are in our device's NodeStatus, sent at once when they change; its
`vendor_code` has bit 0 armed, bit 1 timed out, and trips of the watchdog from bit 2 up, modulo 2^14.
DroneCAN carries neither sequence number nor age: the first is inferred, the second is 0.

Source of the AM32 behaviour: github.com/am32-firmware/AM32, Src/DroneCAN/DroneCAN.c.
"""

from typing import Any

from hil.common.errors import ConfigError
from hil.common.schema import parse
from hil.links.contract import MAX_THRUSTERS, Protocol
from hil.links.dronecan.device import DroneCanDevice
from hil.links.dronecan.host import DroneCanHost
from hil.links.dronecan.settings import MOST_ESCS, DeviceSettings, HostSettings
from hil.links.protocols import Role


def open_dronecan(role: Role, channels: int, **settings: Any) -> Protocol:
    """Return one end's protocol. `settings` are those of HostSettings or DeviceSettings, and the device's two hooks.

    Raises ConfigError if a setting is wrong or there are more thrusters than a link carries.
    """
    if not 0 < channels <= MAX_THRUSTERS:
        raise ConfigError(f"protocol dronecan: carries 1 to {MAX_THRUSTERS} thrusters, not {channels}")
    if role == "host":
        host = parse(settings, HostSettings, "protocol dronecan")
        _check_indices(host.esc_index, channels)
        return DroneCanHost(channels, host)
    hooks = {name: settings.pop(name) for name in ("motor_values", "battery_values") if name in settings}
    device = parse(settings, DeviceSettings, "protocol dronecan")
    _check_indices(device.esc_index, channels)
    return DroneCanDevice(channels, device, **hooks)


def _check_indices(first: int, channels: int) -> None:
    if first + channels > MOST_ESCS:
        raise ConfigError(
            f"protocol dronecan: esc_index: {channels} thrusters from {first} on go beyond the {MOST_ESCS} of a command"
        )
