"""Parse the address of a thruster link's wire, and open either end of the wire.

pty:/tmp/uuv-hil-stm32            a pseudo terminal: the STM32's end makes it, with this second name (or none:
                                  "pty:"), the host's end opens it
/dev/ttyUSB0                      a serial device, or any pty by its path
rs485:/dev/ttyUSB0                the same with a driver that switches the direction of an RS-485 bus
tcp://127.0.0.1:5760              the STM32's end listens there, the host's end connects
udp://127.0.0.1:5760              likewise with datagrams; 0.0.0.0 listens to other machines too
can:socketcan:can0                a CAN interface of the kernel
can:slcan:/dev/ttyACM0            a CAN adapter with the Lawicel text protocol; like that of any serial
                                  device its speed is no part of the address
can:socketcand:HOST:PORT          can0 of another machine that runs socketcand; HOST:PORT/can1: another bus of it
can:virtual:bus0                  a bus within this process
can:mcast:0                       a bus between the processes of this machine, 0 to 255, in the form of ArduPilot's
                                  SITL and DroneCAN's tools
can:INTERFACE:CHANNEL             any other interface of the python-can package
NAME:TARGET                       a wire that another package adds (hil.common.plugins)
"""

import os
from typing import Literal, NamedTuple

from hil.common.errors import ConfigError
from hil.links.contract import Wire
from hil.links.protocols import Role, carries_can

FORMS = "pty:/tmp/name, /dev/ttyUSB0, rs485:/dev/ttyUSB0, tcp://host:port, udp://host:port, can:interface:channel"

Kind = Literal["pty", "uart", "rs485", "tcp", "udp", "can", "added"]


class Address(NamedTuple):
    """The parts of an address. `target` is a path, a host or a CAN channel.

    `interface` is the CAN interface, or the name of a wire that another package adds; `channel` the bus of a server.
    """

    kind: Kind
    target: str
    port: int = 0
    interface: str = ""
    channel: str = ""

    @property
    def carries_can(self) -> bool:
        """True if the wire carries CAN frames instead of bytes."""
        return self.kind == "can"


def parse_address(text: str) -> Address:
    """Return the parts of an address. Raises ConfigError, which lists the forms, or says where to set a speed."""
    address = _parts(text)
    device, _, speed = address.target.rpartition("@")
    serial = address.kind in ("uart", "rs485") or address.interface == "slcan"
    # python-can accepts such a suffix as a speed. Outside /dev it may be part of a pty's name that a user chose.
    if serial and device.startswith("/dev/") and speed.isascii() and speed.isdigit():
        raise ConfigError(
            f"{text!r}: a speed is no part of it: leave @{speed} out, and set baud = {speed} in [link] "
            "(--baud of stm32 and loopback)"
        )
    return address


def incompatibility(protocol: str, port: str) -> str | None:
    """Return why this protocol cannot run over this address; None if it can."""
    try:
        address = parse_address(port)
    except ConfigError as error:
        return f"port: {error}"
    try:
        needs_can = carries_can(protocol)
    except ConfigError as error:
        return str(error)
    if address.kind == "added" or address.carries_can == needs_can:
        return None
    needed = "a CAN bus, can:INTERFACE:CHANNEL" if needs_can else "a wire of bytes, no CAN bus"
    return f"protocol {protocol!r} needs {needed}, and the port is {port!r}"


def wire_kind(name: str) -> Kind:
    """Return the kind of an open wire from its name; the path of a pty gives "pty". Raises ConfigError."""
    address = parse_address(name)
    is_path = address.kind in ("pty", "uart", "rs485")
    return "pty" if is_path and os.path.realpath(address.target).startswith("/dev/pts/") else address.kind


def open_address(text: str, role: Role, baud: int = 115_200, bitrate: int = 1_000_000) -> Wire:
    """Open one end of the wire at `text`: role "device" is the STM32's end, "host" that of the vehicle's computer.

    baud: speed of a serial device or slcan adapter, bit/s. bitrate: speed of a CAN bus, bit/s, unless the system
    sets it. Raises ConfigError if the address is invalid, DeviceError if it cannot be opened,
    MissingExtraError.
    """
    address = parse_address(text)
    if address.kind == "added":
        from hil.common.plugins import installed, load_object

        wire: Wire = load_object(installed("wires")[address.interface], f"port {text!r}")(address.target, role)
        return wire
    if address.kind == "can":
        return _open_can(address, baud, bitrate)
    if address.kind in ("tcp", "udp"):
        return _open_net(address, role)
    from hil.links.wires.terminal import PtyHostWire, PtyWire, UartWire

    if address.kind != "pty":
        return UartWire(address.target, baud, rs485=address.kind == "rs485")
    if role == "device":
        return PtyWire(address.target)
    if not address.target:
        raise ConfigError(f"{text!r}: the host's end of a pty needs its path, as in pty:/tmp/name")
    return PtyHostWire(address.target)


def _parts(text: str) -> Address:
    scheme, _, parameters = text.partition(":")
    if text.startswith("/"):
        return Address("uart", text)
    if scheme == "pty" and parameters[:1] in ("", "/"):
        return Address("pty", parameters)
    if scheme == "rs485" and parameters.startswith("/"):
        return Address("rs485", parameters)
    if scheme in ("tcp", "udp") and parameters.startswith("//") and (server := _server(parameters[2:])):
        return Address("tcp" if scheme == "tcp" else "udp", *server)
    if scheme == "can":
        interface, _, channel = parameters.partition(":")
        if interface == "socketcand":
            place, _, bus = channel.partition("/")
            if server := _server(place):
                return Address("can", *server, interface=interface, channel=bus or "can0")
        elif interface and channel:
            return Address("can", channel, interface=interface)
    from hil.common.plugins import installed

    if scheme in installed("wires"):
        return Address("added", parameters, interface=scheme)
    raise ConfigError(f"{text!r} is not the address of a wire; there are {FORMS}")


def _server(text: str) -> tuple[str, int] | None:
    """Return host and port of HOST:PORT; None if it is not that."""
    host, _, port = text.rpartition(":")
    valid = host and port.isascii() and port.isdigit() and int(port) < 65_536
    return (host.strip("[]"), int(port)) if valid else None


def _open_net(address: Address, role: Role) -> Wire:
    from hil.links.wires.net import TcpHostWire, TcpWire, UdpHostWire, UdpWire

    if address.kind == "tcp":
        return (TcpWire if role == "device" else TcpHostWire)(address.target, address.port)
    return (UdpWire if role == "device" else UdpHostWire)(address.target, address.port)


def _open_can(address: Address, baud: int, bitrate: int) -> Wire:
    if address.interface == "socketcan":
        from hil.links.wires.can_bus import open_socketcan

        return open_socketcan(address.target)
    if address.interface == "slcan":
        from hil.links.wires.terminal import UartWire
        from hil.links.wires.text_can_bus import SlcanWire

        return SlcanWire(UartWire(address.target, baud), bitrate)
    if address.interface == "socketcand":
        from hil.links.wires.net import TcpHostWire
        from hil.links.wires.text_can_bus import SocketcandWire

        return SocketcandWire(TcpHostWire(address.target, address.port), address.channel)
    if address.interface == "mcast":
        from hil.links.wires.multicast_bus import MulticastCanWire

        return MulticastCanWire(address.target)
    if address.interface == "virtual":
        from hil.links.wires.virtual_bus import VirtualCanWire

        return VirtualCanWire(address.target)
    if address.interface == "udp_multicast":  # python-can's returns our own frames, and sends them to other machines
        raise ConfigError(f"can:udp_multicast:{address.target}: use can:mcast:0, or another number up to 255")
    from hil.links.wires.python_can_bus import PythonCanWire

    return PythonCanWire(address.interface, address.target, bitrate)
