"""Settings of a MAVLink thruster link, and the record of ESC measurements. Does not load pymavlink."""

from typing import Annotated, Literal, NamedTuple

from hil.common.schema import Range

Id = Annotated[int, Range(1, 255)]


class MavlinkSettings(NamedTuple):
    """Settings of both ends; the host alone uses `command`.

    system, component: the device's ids; the host is `host_component` of the same system (191: onboard computer).
    Messages without an address are accepted only within that system.
    signing_key: 64 hexadecimal digits, or a passphrase whose SHA-256 is the key; empty: packets are not signed.
    """

    command: Literal["servo_output_raw", "rc_channels_override"] = "servo_output_raw"
    system: Id = 1
    component: Id = 1
    host_component: Id = 191
    signing_key: str = ""

    def validate(self) -> str | None:
        """Return an error if both components have the same id, else None."""
        return "component and host_component are the same" if self.component == self.host_component else None


class EscReading(NamedTuple):
    """Measured values of one ESC. On the wire each is an unsigned integer in the unit in brackets."""

    speed: float  # rad/s, its magnitude (rpm)
    voltage: float  # V (0.01)
    current: float  # A (0.01)
    temperature: float  # degC (1)
    charge: float  # A s consumed since power-up (mA h)
