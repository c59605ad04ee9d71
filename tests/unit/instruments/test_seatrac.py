"""SeaTrac's beacons: lines, settings, and exchanges whose times and places are those of the water between them."""

from math import radians
from struct import unpack_from
from typing import Any

import pytest

from hil.common.clock import NS_PER_MS
from hil.instruments.contract import Client
from hil.instruments.seatrac.link import LinkSettings, SeatracLink
from sim.dynamics import State
from sim.modems.acoustic import AcousticModem
from sim.rotations import from_euler
from sim.sensors.error import ErrorModel
from sim.sensors.usbl import UsblModel
from tests.support.instrument_bench import CLIENT, Bench, crc_a001

VEHICLE = Client(1, "pty", "vehicle")
MODEL = UsblModel(station=(0.0, 0.0, 2.0), range=ErrorModel(), angle=ErrorModel())
FIELDS = ("count", "time", "range", "channels", "a", "b", "c", "d", "azimuth", "elevation", "fit", "east", "north", "z")


def command(*data: int) -> bytes:
    body = bytes(data)
    return b"#" + (body + crc_a001(body, 0).to_bytes(2, "little")).hex().upper().encode() + b"\r\n"


def reports(sent: bytes, without_status: bool = True) -> list[bytes]:
    """Return the payloads of all lines, each with its checksum right."""
    found = []
    for line in sent.split(b"\r\n")[:-1]:
        data = bytes.fromhex(line[1:].decode())
        assert line[:1] == b"$"
        assert line == line.upper()
        assert crc_a001(data[:-2], 0) == int.from_bytes(data[-2:], "little")
        found.append(data[:-2])
    return [each for each in found if each[0] != 0x10 or not without_status]


def read_fix(data: bytes) -> tuple[dict[str, Any], bytes]:
    """Return an ACOFIX as drivers read it, field after field by its flags, and what is behind it."""
    names = ("to", "from", "flags", "kind", "yaw", "pitch", "roll", "depth", "vos", "rssi")
    fix, at = dict(zip(names, unpack_from("<4B3h2Hh", data), strict=True)), 16
    parts = ((1, "<IiH", 10, FIELDS[:3]), (2, "<B7h", 15, FIELDS[3:11]), (4, "<3h", 6, FIELDS[11:]))
    for bit, form, size, fields in parts:
        if fix["flags"] & bit:
            fix |= dict(zip(fields, unpack_from(form, data, at), strict=True))
            at += size
    return fix, data[at:]


def bench(**settings: Any) -> Bench:
    made = Bench(SeatracLink, MODEL, LinkSettings(**settings))
    made.tick()
    made.device.connected(VEHICLE, made.now_ns)
    made.scene.present = State((30.0, 40.0, 12.0), from_euler(0.0, radians(10.0), radians(90.0)))
    return made


def test_a_ping_comes_back_after_the_time_of_the_sound_with_range_angles_and_position() -> None:
    device = bench(heading=radians(45.0))
    assert reports(device.ask(command(0x40, 1, 4))) == [bytes((0x40, 0, 1))]
    assert reports(device.ask(command(0x40, 1, 4))) == [bytes((0x40, 0x30, 1))]  # busy
    distance = (30.0**2 + 40.0**2 + 10.0**2) ** 0.5
    seconds = 2 * distance / 1500.0 + 2 * (0.03 + 0.16) + 0.01
    (request,) = reports(device.run(seconds - 0.02))
    (response,) = reports(device.run(0.04))
    assert (request[0], response[0]) == (0x41, 0x42)
    at_vehicle, _ = read_fix(request[1:])
    assert (at_vehicle["to"], at_vehicle["from"], at_vehicle["flags"], at_vehicle["kind"]) == (1, 15, 0, 4)
    assert (at_vehicle["yaw"], at_vehicle["pitch"], at_vehicle["depth"]) == (900, 100, 120)
    fix, rest = read_fix(response[1:])
    assert rest == b""
    assert (fix["to"], fix["from"], fix["flags"], fix["kind"], fix["yaw"], fix["depth"]) == (15, 1, 7, 5, 450, 20)
    assert fix["range"] == round(10 * distance)
    assert fix["time"] / 1e7 * fix["vos"] / 10 == pytest.approx(distance, abs=0.01)
    assert fix["count"] / 16_000 == pytest.approx(2 * fix["time"] / 1e7 + 0.01, abs=1e-4)
    assert fix["azimuth"] / 10 == pytest.approx(53.13 - 45.0, abs=0.06)
    assert fix["elevation"] / 10 == pytest.approx(-11.31, abs=0.06)
    assert (fix["north"], fix["east"], fix["z"], fix["channels"]) == (300, 400, 120, 4)


def test_plain_and_enhanced_requests_differ_and_a_modem_measures_no_angles() -> None:
    device = bench()
    for kind, flags in ((2, 1), (4, 7), (6, 15)):
        device.ask(command(0x40, 1, kind))
        fix, _ = read_fix(reports(device.run(0.6))[-1][1:])
        assert (fix["flags"], fix["kind"]) == (flags, kind + 1)
    assert fix["z"] == 120
    device.device.on_data(VEHICLE, command(0x40, 15, 4), device.now_ns)
    fix, _ = read_fix(reports(device.run(0.6))[-1][1:])
    assert (fix["flags"], fix["to"], fix["from"]) == (1, 1, 15)


def test_an_x150_on_the_vehicle_sees_the_station_from_its_own_axes() -> None:
    device = bench(end="vehicle", x150="vehicle")
    device.ask(command(0x40, 15, 4))
    fix, _ = read_fix(reports(device.run(0.6))[-1][1:])
    assert (fix["north"], fix["east"], fix["z"]) == (-300, -400, 20)
    assert fix["azimuth"] / 10 == pytest.approx(141.46, abs=0.06)  # starboard aft, as the vehicle looks to the east
    settings = bytearray(reports(device.ask(command(0x15)))[0][1:])
    settings[-15] &= ~1  # positions by the attitude that is set: north, level
    device.ask(command(0x16, *settings))
    device.ask(command(0x40, 15, 4))
    turned, _ = read_fix(reports(device.run(0.6))[-1][1:])
    assert turned["azimuth"] == fix["azimuth"]
    assert (turned["north"], turned["east"]) == pytest.approx((-377, 300), abs=1)


def test_data_go_both_ways_and_acknowledgements_carry_what_was_queued() -> None:
    device = bench()
    device.device.on_data(VEHICLE, command(0x64, 15, 3, *b"yes"), device.now_ns)
    assert reports(device.ask(command(0x60, 1, 4, 5, *b"hello", *bytes(25)))) == [bytes((0x60, 0, 1))]
    received, returned = reports(device.run(1.5))
    assert (received[0], read_fix(received[1:])[1]) == (0x61, b"\x00\x05hello\x01")
    fix, rest = read_fix(returned[1:])
    assert (returned[0], rest, fix["flags"]) == (0x61, b"\x01\x03yes\x01", 7)
    device.device.on_data(VEHICLE, command(0x60, 0, 1, 2, *b"up"), device.now_ns)
    (received,) = reports(device.run(1.0))
    fix, rest = read_fix(received[1:])
    assert (rest, fix["to"], fix["from"], fix["flags"]) == (b"\x00\x02up\x01", 0, 1, 2)  # to all; angles, no range


def test_a_query_returns_what_it_asked_for() -> None:
    device = bench()
    device.ask(command(0x50, 1, 0x0F, 0))
    response = reports(device.run(2.0))[-1]
    _, rest = read_fix(response[1:])
    depth, supply, temperature, *angles, local = unpack_from("<iHh3hB", rest, 1)
    assert (response[0], rest[0], depth, supply, temperature) == (0x52, 15, 120, 12_000, 100)
    assert (angles[:2], local) == ([900, 100], 1)


@pytest.mark.parametrize(
    ("sent", "error"),
    [((0x40, 1, 4), 0x43), ((0x60, 1, 2, 1, 65), 0x63), ((0x50, 1, 1, 0), 0x53), ((0x48, 1, 2, 1, 65), 0x4B)],
)
def test_a_request_times_out_when_the_other_does_not_hear_it(sent: tuple[int, ...], error: int) -> None:
    device = bench()
    device.scene.present = State((30.0, 40.0, -1.0))  # out of the water
    device.ask(command(*sent))
    assert reports(device.run(8.0)) == [bytes((error, 0x34, 1))]
    device.scene.present = State((30.0, 40.0, 2.0))
    device.ask(command(sent[0], 7, *sent[2:]))  # there is no beacon of this number
    assert reports(device.run(8.0)) == [bytes((error, 0x34, 7))]


def test_noise_damages_messages_and_who_sends_does_not_hear() -> None:
    device = bench(modem=AcousticModem(bit_rate=100.0, source_level=100.0, wind=40.0))
    device.ask(command(0x40, 1, 4))
    assert reports(device.run(8.0)) == [bytes((0x43, 0x34, 1))]
    device = bench()
    device.device.on_data(VEHICLE, command(0x60, 0, 0, 2, *b"up"), device.now_ns)
    device.now_ns += 100 * NS_PER_MS
    device.ask(command(0x40, 1, 4))
    heard = reports(device.run(8.0))
    assert [each[0] for each in heard] == [0x43]  # neither: each sent while the other's message came


def test_status_comes_at_its_rate_with_the_parts_that_are_set() -> None:
    device = bench()
    lines = reports(device.run(3.005), without_status=False)
    assert len([each for each in lines if len(each) == 30]) == 2 * 3  # of both beacons
    status = lines[-2]
    _, output, _, supply, _, pressure, depth, vos, yaw = unpack_from("<BBQHhiiHh", status)
    assert (output, supply, depth, vos, yaw) == (3, 12_000, 20, 15_000, 0)
    assert pressure == pytest.approx(1214, abs=1)
    assert reports(device.ask(command(0x12, 0x0E, 4))) == [bytes((0x12, 0))]
    assert reports(device.ask(command(0x11))) == [bytes((0x11, 0x0E, 4))]
    lines = reports(device.run(1.0), without_status=False)
    assert len([each for each in lines if len(each) == 10 + 6 + 7 + 12]) == pytest.approx(10, abs=1)
    assert len(reports(device.ask(command(0x10)), without_status=False)[0]) == 35


def test_settings_are_kept_when_saved_and_refused_when_out_of_range() -> None:
    device = bench()
    (answer,) = reports(device.ask(command(0x15)))
    assert len(answer) == 1 + 110
    settings = bytearray(answer[1:])
    at = len(settings) - 14  # the number: before five of 2 bytes and three of the filter
    assert settings[at] == 15
    for number, result in ((9, 0), (16, 5), (0, 5)):
        settings[at] = number
        assert reports(device.ask(command(0x16, *settings))) == [bytes((0x16, result))]
    assert reports(device.ask(command(0x16, 1, 2, 3))) == [bytes((0x16, 4))]
    assert reports(device.ask(command(0x18))) == [bytes((0x18, 0))]
    device.restart()
    assert reports(device.ask(command(0x15)))[0][1 + at] == 9
    device.ask(command(0x19))
    assert reports(device.ask(command(0x15)))[0][1 + at] == 15
    device.ask(command(0x17))
    assert reports(device.ask(command(0x15)))[0][1 + at] == 9
    (info,) = reports(device.ask(command(0x02)))
    assert (len(info), unpack_from("<H", info, 6)[0]) == (1 + 4 + 1 + 11 + 11 + 11 + 1, 795)
    device.now_ns += 5000 * NS_PER_MS
    assert unpack_from("<BI", reports(device.ask(command(0x01)))[0]) == (1, 5)
    assert reports(device.ask(command(0x03, 0x95, 0x6A))) == [bytes((3, 0))]
    assert unpack_from("<BI", reports(device.ask(command(0x01)))[0]) == (1, 0)


def test_malformed_lines_are_counted_and_lines_come_in_pieces() -> None:
    device = bench()
    for line in (b"#40010\r\n", b"$" + command(1)[1:], b"#0101FF\r\n", b"hello\r\n", command(0xEE)):
        assert device.ask(line) == b""
    assert device.device.malformed == 5
    sent = b"".join(device.ask(bytes((byte,))) for byte in command(0x01))
    assert len(reports(sent)) == 1
    assert device.device.malformed == 5
    assert CLIENT.wire == 0
