"""Record of the section [mavlink], and the endpoints that it names; `uuv-hil gateway mavlink` reads both."""

from typing import Annotated, Literal, NamedTuple

from hil.common.endpoint import validate_endpoint
from hil.common.errors import ConfigError
from hil.common.schema import Range

FORMS = (
    "udpout:HOST:PORT, udpin:HOST:PORT, tcpin:HOST:PORT, tcpout:HOST:PORT, serial:/dev/ttyUSB0:57600, "
    "zenoh:tcp/HOST:PORT"
)
BAUD = 57_600  # default for a serial device
Kind = Literal["udpout", "udpin", "tcpin", "tcpout", "serial", "zenoh"]


class MavlinkEndpoint(NamedTuple):
    """The parts of an endpoint; `target` is a host, a device or the endpoint of a zenoh router."""

    kind: Kind
    target: str
    port: int = 0  # for a serial device its speed in bit/s


def parse_endpoint(text: str) -> MavlinkEndpoint:
    """Return the parts of an endpoint. Raises ConfigError, which lists the valid forms."""
    kind, _, address = text.partition(":")
    if kind == "serial" and address.startswith("/"):
        device, _, baud = address.rpartition(":")
        if device and baud.isdecimal() and 1200 <= int(baud) <= 12_000_000:
            return MavlinkEndpoint("serial", device, int(baud))
        if ":" not in address:
            return MavlinkEndpoint("serial", address, BAUD)
    elif kind == "zenoh" and validate_endpoint("zenoh", address) is None:
        return MavlinkEndpoint("zenoh", address)
    elif kind in ("udpout", "udpin", "tcpin", "tcpout"):
        host, _, port = address.rpartition(":")
        if host and port.isascii() and port.isdecimal() and int(port) < 65_536 and (int(port) or kind.endswith("in")):
            words: dict[str, Kind] = {"udpout": "udpout", "udpin": "udpin", "tcpin": "tcpin", "tcpout": "tcpout"}
            return MavlinkEndpoint(words[kind], host.strip("[]"), int(port))
    raise ConfigError(f"{text!r} is not a MAVLink endpoint; there are {FORMS}")


def rtp_target(text: str) -> tuple[str, int] | None:
    """Return host and UDP port of HOST:PORT; None for "". Raises ConfigError."""
    if not text:
        return None
    host, _, port = text.rpartition(":")
    if not host or not (port.isascii() and port.isdigit() and 0 < int(port) <= 65_535):
        raise ConfigError(f"{text!r}: expected HOST:PORT of a ground station, such as 127.0.0.1:5600")
    return host.strip("[]"), int(port)


class Mavlink(NamedTuple):
    """MAVLink interface of the vehicle for ground stations and companion software, in a process beside the slave.

    `endpoints` are its connections: "udpout" sends to a ground station, "udpin" and "tcpin" wait for several, "tcpout"
    connects to a router, "serial" is a radio or a companion computer, "zenoh" offers the keys of BlueOS. `system` is
    its MAVLink system id, 2 instead of 1 if an autopilot with that id flies the vehicle. `autopilot` is the firmware
    whose mode numbers and mission rules it follows: "ardupilot" means ArduSub, which QGroundControl supports best,
    "generic" the MAVLink standard alone. Ground stations on other machines may only observe unless `commands_from` is
    "network". `signing_key`, a passphrase or 64 hexadecimal digits, signs all packets and refuses unsigned ones.
    `parameters` is the file of stored parameters (default: a file of this user for the node), `logs` the folder that
    MAVFTP offers. `rtp` ("HOST:PORT") receives the picture of the
    camera that `camera` names, as H.264. With `start` the slave starts this process;
    otherwise run `uuv-hil gateway mavlink`.
    """

    endpoints: tuple[str, ...] = ("udpout:127.0.0.1:14550", "tcpin:127.0.0.1:5760")
    system: Annotated[int, Range(1, 250)] = 1
    autopilot: Literal["ardupilot", "generic"] = "ardupilot"
    commands_from: Literal["localhost", "network"] = "localhost"
    signing_key: str = ""
    parameters: str = ""
    logs: str = "recordings"
    rtp: str = ""
    camera: str = "camera"
    start: bool = True

    def validate(self) -> str | None:
        """Return why an endpoint is invalid, or None."""
        try:
            for text in self.endpoints:
                parse_endpoint(text)
        except ConfigError as error:
            return f"endpoints: {error}"
        try:
            rtp_target(self.rtp)
        except ConfigError as error:
            return f"rtp: {error}"
        return None if self.endpoints else "endpoints: none is given; name at least one"
