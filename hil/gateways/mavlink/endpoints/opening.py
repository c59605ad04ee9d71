"""Open the endpoints that a scenario or a command names."""

from hil.gateways.mavlink.endpoints.links import Link, TcpIn, TcpOut, UdpIn, UdpOut
from hil.gateways.mavlink.endpoints.serial_link import SerialLink
from hil.scenario.mavlink_records import MavlinkEndpoint


def open_link(endpoint: MavlinkEndpoint) -> Link:
    """Open an endpoint. Raises NetworkError, DeviceError."""
    if endpoint.kind == "serial":
        return SerialLink(endpoint.target, endpoint.port)
    if endpoint.kind == "zenoh":
        from hil.gateways.mavlink.endpoints.zenoh_link import ZenohLink  # few want it

        return ZenohLink(endpoint.target)
    kinds: dict[str, type[UdpOut | UdpIn | TcpIn | TcpOut]] = {
        "udpout": UdpOut, "udpin": UdpIn, "tcpin": TcpIn, "tcpout": TcpOut,
    }  # fmt: skip
    return kinds[endpoint.kind](endpoint.target, endpoint.port)
