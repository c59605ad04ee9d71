"""Record of the section [mavlink], and the endpoints that it names; `uuv-hil gateway mavlink` reads both."""

from typing import Annotated, Literal, NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import Range

FORMS = "udpout:HOST:PORT, udpin:HOST:PORT, tcpin:HOST:PORT, tcpout:HOST:PORT, serial:/dev/ttyUSB0:57600"
BAUD = 57_600  # default for a serial device
Kind = Literal["udpout", "udpin", "tcpin", "tcpout", "serial"]


class MavlinkEndpoint(NamedTuple):
    """The parts of an endpoint; `target` is a host or a device."""

    kind: Kind
    target: str
    port: int = 0  # for a serial device its speed in bit/s


def parse_endpoint(text: str) -> MavlinkEndpoint:
    """Return the parts of an endpoint. Raises ConfigError, which lists the valid forms."""
    kind, _, address = text.partition(":")
    words: dict[str, Kind] = {"udpout": "udpout", "udpin": "udpin", "tcpin": "tcpin", "tcpout": "tcpout"}
    if kind == "serial" and (line := device_and_baud(address, BAUD)):
        return MavlinkEndpoint("serial", *line)
    if kind in words and (place := host_and_port(address)) and (place[1] or kind.endswith("in")):
        return MavlinkEndpoint(words[kind], *place)
    raise ConfigError(f"{text!r} is not a MAVLink endpoint; there are {FORMS}")


def host_and_port(text: str) -> tuple[str, int] | None:
    """Return host, without brackets, and port of HOST:PORT; None for any other text."""
    host, _, port = text.rpartition(":")
    is_port = port.isascii() and port.isdecimal() and int(port) < 65_536
    return (host.strip("[]"), int(port)) if host and is_port else None


def device_and_baud(text: str, baud: int) -> tuple[str, int] | None:
    """Return path and speed (bit/s) of DEVICE:BAUD or, at `baud`, DEVICE; None for any other text."""
    if not text.startswith("/"):
        return None
    device, _, speed = text.rpartition(":")
    if device and speed.isdecimal() and 1200 <= int(speed) <= 12_000_000:
        return device, int(speed)
    return None if ":" in text else (text, baud)


class Mavlink(NamedTuple):
    """MAVLink interface of the vehicle for ground stations and companion software, in a process beside the slave.

    `endpoints` are its connections: "udpout" sends to a ground station, "udpin" and "tcpin" wait for several, "tcpout"
    connects to a router, "serial" is a radio or a companion computer. `system` is its MAVLink system id, 2 instead of 1
    if an autopilot with that id flies the vehicle. `autopilot` is the firmware whose mission rules it follows:
    "ardupilot" means ArduSub, which QGroundControl supports best, "generic" the MAVLink standard alone. Ground stations
    on other machines may only observe unless `commands_from` is "network". `signing_key`, a passphrase or 64
    hexadecimal digits, signs all packets and refuses unsigned ones. `parameters` is the file of stored parameters
    (default: a file of this user for the node), `logs` the folder that MAVFTP offers. With `start` the slave starts
    this process; otherwise run `uuv-hil gateway mavlink`.
    """

    endpoints: tuple[str, ...] = ("udpout:127.0.0.1:14550", "tcpin:127.0.0.1:5760")
    system: Annotated[int, Range(1, 250)] = 1
    autopilot: Literal["ardupilot", "generic"] = "ardupilot"
    commands_from: Literal["localhost", "network"] = "localhost"
    signing_key: str = ""
    parameters: str = ""
    logs: str = "recordings"
    start: bool = True

    def validate(self) -> str | None:
        """Return why an endpoint is invalid, or None."""
        try:
            for text in self.endpoints:
                parse_endpoint(text)
        except ConfigError as error:
            return f"endpoints: {error}"
        return None if self.endpoints else "endpoints: none is given; name at least one"
