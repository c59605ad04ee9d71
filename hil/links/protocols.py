"""Table of the protocols of thruster links, by name; each is imported when a link uses it."""

from collections.abc import Callable
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
    """Return one end of the protocol `kind` for this number of thrusters.

    `kind` is a key of `PROTOCOLS`, a name that another package adds, or "module:function" of a factory like ours. The
    attribute `on_can` of a factory is true if its data are CAN frames. Raises ConfigError if there
    is no such protocol or it cannot carry so many thrusters; MissingExtraError.
    """
    protocol: Protocol = _factory(kind)(role, channels, **settings)
    return protocol


def carries_can(kind: str) -> bool:
    """Return whether a protocol's data are CAN frames. Raises ConfigError if there is no such protocol."""
    return kind in ON_CAN or (kind not in PROTOCOLS and bool(getattr(_factory(kind), "on_can", False)))


def _factory(kind: str) -> Callable[..., Protocol]:
    """Return the factory of a protocol: ours, "module:function", or one that another package adds."""
    from hil.common.plugins import installed, load_object

    place = PROTOCOLS.get(kind) or (kind if ":" in kind else installed("protocols").get(kind))
    if not place:
        from hil.common.schema import nearest

        known = [*PROTOCOLS, *sorted(installed("protocols"))]
        raise ConfigError(f"protocol: {kind!r} is not one of {', '.join(known)}{nearest(kind, known)}")
    factory: Callable[..., Protocol] = load_object(place, "protocol")
    return factory
