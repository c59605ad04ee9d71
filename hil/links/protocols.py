"""Table of the protocols of thruster links, by name; each is imported when a link uses it."""

from typing import Any, Literal

from hil.common.errors import ConfigError
from hil.links.contract import Protocol

Role = Literal["host", "device"]  # the vehicle's computer, the STM32

# A factory takes the end's role, the number of thrusters, and its own settings as keywords.
PROTOCOLS = {
    "frame": "hil.links.frame.protocol:open_frame",
    "mavlink": "hil.links.mavlink.link:open_mavlink",
    "dronecan": "hil.links.dronecan.link:open_dronecan",
    "vesc": "hil.links.vesc.link:open_vesc",
}
ON_CAN = ("dronecan", "vesc")  # their data are CAN frames, see `hil.links.wires.can_frame`; the others' are bytes


def open_protocol(kind: str, role: Role, channels: int, **settings: Any) -> Protocol:
    """Return one end of the protocol `kind`, a key of `PROTOCOLS`, for this number of thrusters.

    Raises ConfigError if there is no such protocol or it cannot carry so many thrusters; MissingExtraError.
    """
    if kind not in PROTOCOLS:
        raise ConfigError(f"protocol: {kind!r} is not one of {', '.join(PROTOCOLS)}")
    import importlib

    module, _, name = PROTOCOLS[kind].partition(":")
    protocol: Protocol = getattr(importlib.import_module(module), name)(role, channels, **settings)
    return protocol
