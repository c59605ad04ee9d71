"""Pressure sensors: Keller's bus by the driver on PyPI, MODBUS by its rules, and Digiquartz's lines."""

from struct import pack, unpack
from typing import Any

import pytest
from keller_protocol.keller_protocol import KellerProtocol

from hil.common.clock import NS_PER_MS
from hil.instruments.keller import Keller33X, KellerSettings
from hil.instruments.paroscientific import Digiquartz, DigiquartzSettings
from sim.sensors.pressure import PressureModel
from sim.sensors.samples import PressureSample
from tests.support.instrument_bench import CLIENT, WALL_NS, Bench, Line, crc_a001

BAR = 3.141593


def keller(**settings: Any) -> Bench:
    made = Bench(Keller33X, PressureModel(), KellerSettings(**settings))
    made.sample(PressureSample(WALL_NS, BAR * 1e5))
    return made


@pytest.mark.parametrize("echo", [False, True])
def test_keller_s_driver_initialises_reads_scales_and_addresses(echo: bool) -> None:
    device = keller(echo=echo, address=7)
    driver = KellerProtocol.__new__(KellerProtocol)
    driver.serial, driver.echo = Line(device), echo
    with pytest.raises(Exception, match=f"Device Error number: {73 | 0x80}"):
        driver.f73(7, 1)  # not before it is initialised
    assert driver.f48(250).startswith("5.20")
    assert driver.f73(7, 1) == pytest.approx(BAR)
    assert driver.f73(250, 4) == pytest.approx(10.0)
    assert driver.f74(7, 1) == round(BAR * 1e5)
    assert isinstance(driver.f69(7), int)
    assert (driver.f30(7, 80), driver.f30(7, 81)) == (0.0, 30.0)
    driver.f31(7, 65, 2.0)
    assert driver.f73(7, 1) == pytest.approx(2 * BAR)
    driver.f31(7, 65, 1.0)
    driver.f95(7, 0)
    assert driver.f73(7, 1) == pytest.approx(0.0, abs=1e-6)
    driver.f95(7, 0, 1.0)
    assert driver.f73(7, 1) == pytest.approx(1.0)
    driver.f95(7, 1)
    assert driver.f73(7, 1) == pytest.approx(BAR)
    for function, number in ((driver.f73, 3), (driver.f30, 12)):
        with pytest.raises(Exception, match="Device Error"):
            function(7, number)
    assert driver.f66(7, 9) == 9
    with pytest.raises(ConnectionRefusedError):
        driver.f73(7, 1)
    device.restart()
    device.sample(PressureSample(WALL_NS, 100e5))
    driver.f48(9)
    assert driver.f73(9, 1) == pytest.approx(33.0)  # saturated


def modbus(*body: int) -> bytes:
    return bytes(body) + pack("<H", crc_a001(bytes(body), 0xFFFF))


def test_keller_reads_by_modbus_and_recovers_from_garbage() -> None:
    device = keller()
    answer = device.ask(modbus(1, 3, 0, 2, 0, 2))
    assert answer == modbus(*answer[:-2])
    assert (answer[:3], unpack(">f", answer[3:7])[0]) == (b"\x01\x03\x04", pytest.approx(BAR))
    assert device.ask(modbus(1, 4, 0, 1, 0, 2)) == modbus(1, 0x84, 2)
    assert device.ask(modbus(1, 8, 0, 0, 0xAB, 0xCD)) == modbus(1, 8, 0, 0, 0xAB, 0xCD)
    assert device.ask(b"\xff" * 3) == b""
    device.now_ns += 100 * NS_PER_MS
    assert len(b"".join(device.ask(bytes((byte,))) for byte in modbus(1, 3, 0, 2, 0, 2))) == 9
    assert device.ask(modbus(1, 3, 0, 2, 0, 2)[:-1] + b"\0") == b""
    assert device.device.malformed == 2
    assert device.ask(modbus(2, 3, 0, 2, 0, 2)) == b""  # another's address


def test_digiquartz_answers_in_its_units_and_streams_until_told_otherwise() -> None:
    device = Bench(Digiquartz, PressureModel(), DigiquartzSettings())
    water = PressureSample(WALL_NS, 200_000.0)
    assert device.ask(b"*0100P3\r\n") == b""  # nothing measured yet
    assert device.sample(water) == b""
    assert device.ask(b"*0100P3\r\n") == b"*000129.00755\r\n"  # psi
    assert float(device.ask(b"*0100Q3\r\n")[5:]) == 10.0
    assert device.ask(b"*0100UN=2\r\n") == b"*0001UN=1\r\n"  # writing is not enabled
    assert device.ask(b"*0100EW*0100UN=2\r\n") == b"*0001UN=2\r\n"
    assert device.ask(b"*0100EW*0100PR=100\r") == b"*0001PR=100\r\n"
    assert device.ask(b"*0100EW*0100UN=9\r") == b"*0001UN=2\r\n"
    assert device.ask(b"*9900P3\r") == b"*00012000\r\n"  # hPa, by the address of all
    assert device.ask(b"*0200P3\r\n") == b""
    assert device.ask(b"*0100P4\r\n") == b""
    assert device.sample(water) == b"*00012000\r\n"
    assert device.ask(b"*0100VR\r\n").startswith(b"*0001VR=")
    assert device.sample(water) == b""
    device.ask(b"*0100EW*0100ID=42\r\n")
    device.restart()
    device.sample(water)
    assert device.ask(b"*4200P3\r\n") == b"*00422000\r\n"
    assert device.device.malformed == 0
    for line in (b"hello\r\n", b"*0100P\r\n", b"*4200XX\r\n"):
        assert device.ask(line) == b""
    assert device.device.malformed == 3
    device.device.disconnected(CLIENT, 0)
