"""Check whether a line is fast enough for the commands that a link sends."""

from math import ceil

from hil.links.address import Address
from hil.links.contract import PWM_NEUTRAL_US, Protocol, ThrusterCommand
from hil.links.wires.faults import line_bits

USABLE = 0.9  # share of a line; heartbeats and the like take the rest


def line_speed(address: Address, baud: int, bitrate: int, faults_baud: int = 0) -> tuple[int, str]:
    """Return the speed (bit/s) of a link's slowest part, and the key of [link] that sets it; (0, "") without a limit.

    baud: for a serial device; bitrate: for a CAN bus; faults_baud: of `[link.faults]`, 0 for none.
    """
    speeds = [(faults_baud, "faults.baud")] if faults_baud else []
    if address.kind in ("uart", "rs485"):
        speeds.append((baud, "baud"))
    elif address.kind == "can":
        speeds.append((bitrate, "bitrate"))
    return min(speeds, default=(0, ""))


def validate_rate(protocol: Protocol, channels: int, address: Address, speed: int, rate: float) -> str | None:
    """Return why a line of `speed` bit/s cannot carry `rate` commands a second for these channels; None if it can.

    protocol: a host's end that is used for nothing else. Only commands are counted: telemetry has its own line on a
    UART, and is additional load on a CAN bus.
    """
    neutral = ThrusterCommand(0, False, (PWM_NEUTRAL_US,) * channels)
    data = protocol.encode_settled(neutral)
    bits = line_bits(data, address.carries_can)
    needed, carried = bits * rate / USABLE, USABLE * speed / bits
    if needed <= speed:
        return None
    return (
        f"{speed} bit/s carry {carried:.3g} commands a second of {bits} bits each, and {rate:.3g} are to be sent: "
        f"use at least {needed:.0f} bit/s, or a control_period of {ceil(1000 / carried)} ms or more in [slave]"
    )
