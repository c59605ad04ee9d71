"""Addresses of wires: each form, the wire that it opens at each end, and invalid addresses."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.common.errors import ConfigError, DeviceError
from hil.links.address import Address, open_address, parse_address
from hil.links.wires.net import TcpHostWire, TcpWire, UdpHostWire, UdpWire
from hil.links.wires.terminal import PtyHostWire, PtyWire, UartWire
from hil.links.wires.text_can_bus import SlcanWire
from hil.links.wires.virtual_bus import VirtualCanWire
from tests.support.links.link_contract import nothing_leaks, read_bytes, wait_readable


@pytest.fixture(autouse=True)
def _no_leaks() -> Iterator[None]:
    with nothing_leaks():
        yield


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("pty", Address("pty", "")),
        ("pty:/tmp/x", Address("pty", "/tmp/x")),
        ("/dev/serial/by-id/usb-1:2", Address("uart", "/dev/serial/by-id/usb-1:2")),
        ("rs485:/dev/ttyUSB0", Address("rs485", "/dev/ttyUSB0")),
        ("tcp://127.0.0.1:5760", Address("tcp", "127.0.0.1", 5760)),
        ("udp://my-board.local:14550", Address("udp", "my-board.local", 14550)),
        ("tcp://[::1]:5760", Address("tcp", "::1", 5760)),
        ("can:socketcan:can0", Address("can", "can0", interface="socketcan")),
        ("can:slcan:/dev/ttyACM0", Address("can", "/dev/ttyACM0", interface="slcan")),
        ("can:robotell:/dev/ttyUSB0@115200", Address("can", "/dev/ttyUSB0@115200", interface="robotell")),
        ("/dev/serial/by-path/usb@14.0-port0", Address("uart", "/dev/serial/by-path/usb@14.0-port0")),
        ("/tmp/boat@2", Address("uart", "/tmp/boat@2")),  # a pty's name, which a person chose
        ("can:mcast:0", Address("can", "0", interface="mcast")),
        ("can:neovi:ff15::1", Address("can", "ff15::1", interface="neovi")),
    ],
)
def test_each_form_of_address_is_parsed(text: str, address: Address) -> None:
    assert parse_address(text) == address
    assert address.carries_can == text.startswith("can:")


@pytest.mark.parametrize(
    "text",
    [
        *["", "ttyUSB0", "COM3", "serial:/dev/ttyUSB0", "pty:x", "rs485", "rs485:", "rs485:COM3"],
        *["tcp:127.0.0.1:5", "tcp://127.0.0.1", "tcp://:5760", "tcp://host:port", "TCP://host:1"],
        *["udp://host:65536", "udp://host:-1", "udp://host:²", "can:", "can:can0", "can::can0", "can:vcan:"],
        "serial:/dev/ttyUSB0@115200",
    ],
)
def test_an_invalid_address_is_refused(text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_address(text)
    assert str(caught.value).startswith(f"{text!r} is not the address of a wire; there are pty:/tmp/name, ")


@pytest.mark.parametrize("text", ["/dev/ttyUSB0@9600", "rs485:/dev/ttyS1@9600", "can:slcan:/dev/ttyACM0@9600"])
def test_a_speed_is_no_part_of_an_address(text: str) -> None:
    with pytest.raises(ConfigError, match="set baud = 9600"):
        parse_address(text)


def test_a_named_pty_is_opened_at_both_ends(tmp_path: Path) -> None:
    address = f"pty:{tmp_path}/stm32"
    device = open_address(address, "device")
    host = open_address(address, "host")
    assert isinstance(device, PtyWire)
    assert isinstance(host, PtyHostWire)
    host.close()
    uart = open_address(f"{tmp_path}/stm32", "host", baud=57_600)
    assert isinstance(uart, UartWire)
    assert device.baud == 57_600
    uart.close()
    device.close()


def test_a_pty_without_a_name_can_be_opened_by_the_device_only() -> None:
    device = open_address("pty", "device")
    assert device.name.startswith("/dev/pts/")
    device.close()
    with pytest.raises(ConfigError, match="'pty': the host's end of a pty needs its path"):
        open_address("pty", "host")


def test_rs485_mode_is_requested() -> None:
    device = PtyWire()
    with pytest.raises(DeviceError, match="RS-485"):
        open_address(f"rs485:{device.path}", "host")
    device.close()


@pytest.mark.parametrize(
    ("scheme", "listens", "connects"), [("tcp", TcpWire, TcpHostWire), ("udp", UdpWire, UdpHostWire)]
)
def test_tcp_and_udp_addresses_are_opened(scheme: str, listens: type[TcpWire | UdpWire], connects: type) -> None:
    device = open_address(f"{scheme}://127.0.0.1:0", "device")
    assert isinstance(device, listens)
    host = open_address(f"{scheme}://127.0.0.1:{device.port}", "host")
    assert isinstance(host, connects)
    assert host.name == device.name
    assert wait_readable(device)
    device.read()
    host.close()
    device.close()


@pytest.mark.parametrize("scheme", ["tcp", "udp"])
def test_ipv6_addresses_are_opened(scheme: str) -> None:
    device = open_address(f"{scheme}://[::1]:0", "device")
    assert isinstance(device, TcpWire | UdpWire)
    host = open_address(f"{scheme}://[::1]:{device.port}", "host")
    host.write(b"x")
    assert read_bytes(device, 1) == b"x"
    host.close()
    device.close()


def test_can_addresses_are_opened() -> None:
    bus = open_address("can:virtual:address", "device")
    assert isinstance(bus, VirtualCanWire)
    bus.close()
    with pytest.raises(ConfigError, match="use can:mcast:0"):
        open_address("can:udp_multicast:239.74.163.2", "device")
    adapter = PtyWire()
    slcan = open_address(f"can:slcan:{adapter.path}", "host", baud=1_000_000, bitrate=250_000)
    assert isinstance(slcan, SlcanWire)
    assert adapter.baud == 1_000_000
    assert wait_readable(adapter)
    assert b"\rS5\r" in adapter.read()
    slcan.close()
    adapter.close()
    with pytest.raises(DeviceError, match=r"^can:socketcan:can77: "):
        open_address("can:socketcan:can77", "host")
