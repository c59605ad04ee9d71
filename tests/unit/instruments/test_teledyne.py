"""Teledyne's Pathfinder: ensembles by the reader on PyPI and by the manual's offsets, and the commands of drivers."""

from math import cos, radians, sin
from struct import unpack_from
from typing import Any

import pytest
from trdi_adcp_readers.pd0 import pd0_parser

from hil.common.clock import NS_PER_S
from hil.instruments.dvl.pathfinder import NO_VELOCITY, Pathfinder, PathfinderSettings
from sim.dynamics import State
from sim.rotations import from_euler
from sim.sensors.ranging.dvl import DvlModel
from sim.sensors.samples import DvlSample
from tests.support.instrument_bench import WALL_NS, Bench

VELOCITY = (1.2, -0.3, 0.1)
LOCKED = DvlSample(WALL_NS, VELOCITY, 12.34, True)
LOST = DvlSample(WALL_NS, (float("nan"),) * 3, float("nan"), False)


def bench(**settings: Any) -> Bench:
    made = Bench(Pathfinder, DvlModel(), PathfinderSettings(**settings))
    made.scene.present = State((0.0, 0.0, 7.0), from_euler(radians(5.0), radians(-3.0), radians(90.0)))
    return made


def read(data: bytes) -> dict[str, Any]:
    """Return the parts of an ensemble; its bottom track by the offsets of the guide, as that reader has none."""
    header = pd0_parser.parse_fixed_header(data)
    pd0_parser.validate_checksum(data, header["number_of_bytes"])
    assert len(data) == header["number_of_bytes"] + 2
    fixed, variable, bottom = pd0_parser.parse_address_offsets(data, header["number_of_data_types"])
    found: dict[str, Any] = {"header": header, "fixed": pd0_parser.parse_fixed_leader(data, fixed, {})}
    found["variable"] = pd0_parser.parse_variable_leader(data, variable, found)
    assert (variable - fixed, bottom - variable, header["number_of_bytes"] - bottom) == (59, 77, 81 + 2)
    assert unpack_from("<H", data, bottom)[0] == 0x600
    found["ranges"], found["speeds"] = unpack_from("<4H", data, bottom + 16), unpack_from("<4h", data, bottom + 24)
    found["good"], found["high"] = data[bottom + 40 : bottom + 44], data[bottom + 77 : bottom + 81]
    return found


def test_an_ensemble_has_time_attitude_depth_and_the_bottom_s_velocity_in_ship_s_coordinates() -> None:
    device = bench(turnkey=True)
    device.ask(b"===")
    device.ask(b"EX10111\rCS\r")
    found = read(device.sample(LOCKED))
    fixed, variable = found["fixed"], found["variable"]
    assert (fixed["number_of_beams"], fixed["beam_angle"]) == (4, 30)
    assert fixed["coordinate_transformation_process"] == 0b10111
    assert (variable["heading"], variable["pitch"], variable["roll"]) == (9000, -300, 500)
    assert (variable["depth_of_transducer"], variable["speed_of_sound"], variable["temperature"]) == (70, 1500, 1000)
    stamp = found["timestamp"]
    assert (stamp.year, stamp.month, stamp.second) == (2026, 9, WALL_NS // NS_PER_S % 60)
    assert (variable["rtc_y2k_century"], variable["rtc_y2k_year"], variable["rtc_hundredths"]) == (20, 26, 12)
    assert variable["ensemble_number"] == 1
    assert found["speeds"] == (300, -1200, 100, 0)  # the bottom goes to starboard and aft, and comes nearer
    assert (found["ranges"], found["good"], found["high"]) == ((1234,) * 4, bytes([100] * 4), bytes(4))


def test_coordinates_speed_of_sound_and_reach_are_those_that_are_set() -> None:
    device = bench(turnkey=True)
    earth = read(device.sample(LOCKED))["speeds"]  # the factory's; the vehicle looks to the east
    assert earth[0] == pytest.approx(-1200, abs=15)
    assert earth[1] == pytest.approx(-300, abs=15)
    device.ask(b"+++")
    device.ask(b"EX00000\rCS\r")
    tilt = radians(30.0)
    expected = [sin(tilt) * side + cos(tilt) * 0.1 for side in (0.3, -0.3, 1.2, -1.2)]
    assert [each / 1e3 for each in read(device.sample(LOCKED))["speeds"]] == pytest.approx(expected, abs=1e-3)
    device.ask(b"===")
    device.ask(b"EX10000\rEC1530\rCS\r")
    assert read(device.sample(LOCKED))["speeds"][1] == round(-1200 * 1.02)
    device.ask(b"===")
    device.ask(b"BX00100\rCS\r")
    for sample in (LOCKED, LOST):  # deeper than 10 m
        found = read(device.sample(sample))
        assert (found["ranges"], found["speeds"], found["good"]) == ((0,) * 4, (NO_VELOCITY,) * 4, bytes(4))


def test_it_waits_at_the_prompt_keeps_what_it_is_told_to_and_refuses() -> None:
    device = bench()
    assert device.sent.endswith(b"Firmware Version: 67.01\r\n>")
    assert device.sample(LOCKED) == b""
    for command in (b"CR1\r", b"#BX00300\r", b"CF11110\r", b"EA-04500\r", b"es00\r", b"EZ10000010\r", b"CK\r"):
        assert device.ask(command) == command.strip().upper() + b"\r\n>"
    assert device.ask(b"EX?\r") == b"EX?\r\nEX = 11111\r\n>"
    for command in (b"BPA", b"PD6", b"EX12345", b"XX1", b"CB911", b"CB721"):
        assert device.ask(command + b"\r\n") == command + b"\r\n" + command + b" ERR: Bad command parameters!\r\n>"
    assert device.device.malformed == 6
    assert device.ask(b"CS\r") == b"CS\r\n"
    assert device.ask(b"EX00000\r") == b""  # it pings
    assert len(device.sample(LOCKED)) == 6 + 2 * 3 + 59 + 77 + 81 + 2 + 2
    device.restart()
    assert device.sample(LOCKED) == b""
    assert device.ask(b"BX?\r").endswith(b"BX = 00300\r\n>")
    device.ask(b"CF11010\rCS\r")
    assert read(bytes.fromhex(device.sample(LOCKED).decode()))["ranges"] == (1234,) * 4
