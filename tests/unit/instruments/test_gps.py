"""The satellite receiver, read by pynmeagps and pyubx2, and configured by pyubx2's messages."""

from datetime import datetime, timezone
from io import BytesIO
from math import cos, hypot, radians
from typing import Any

import pytest
from pynmeagps import NMEAReader
from pyubx2 import POLL, POLL_LAYER_RAM, SET, SET_LAYER_FLASH, SET_LAYER_RAM, UBX_PROTOCOL, UBXMessage, UBXReader
from pyubx2.ubxtypes_configdb import UBX_CONFIG_DATABASE

from hil.common.clock import NS_PER_S
from hil.instruments.gps.configuration import RATES, defaults
from hil.instruments.gps.receiver import Receiver
from hil.instruments.gps.sky import dilutions, satellites
from hil.instruments.gps.ubx import frame
from sim.dynamics import State
from sim.sensors.extra_samples import FixSample
from sim.sensors.gps import GpsModel
from tests.support.instrument_bench import WALL_NS, Bench

PLACE = (-33.857123456, 151.214987654, 24.9)
FIX = FixSample(WALL_NS, *PLACE, (4.0, 9.0), True)
NO_FIX = FixSample(WALL_NS, float("nan"), float("nan"), float("nan"), (4.0, 9.0), False)
TIME = datetime.fromtimestamp(WALL_NS // NS_PER_S, timezone.utc)


def bench() -> Bench:
    made = Bench(Receiver, GpsModel(), origin=(-33.85, 151.21), origin_altitude=22.4)
    # 3 m/s to the north-east, level
    made.scene.present = State((0.0, 0.0, -0.2), (1.0, 0.0, 0.0, 0.0), (3.0 * 0.6, 3.0 * 0.8, 0.0, 0.0, 0.0, 0.0))
    return made


def sentences(data: bytes) -> dict[str, Any]:
    """Return the last sentence of each kind, by others' reader, which checks every checksum."""
    return {parsed.msgID: parsed for _, parsed in NMEAReader(BytesIO(data), validate=1, quitonerror=2)}


def messages(data: bytes) -> list[Any]:
    reader = UBXReader(BytesIO(data), protfilter=UBX_PROTOCOL, validate=1, quitonerror=2)
    return [parsed for _, parsed in reader]


def test_the_common_sentences_come_without_being_asked_for() -> None:
    device = bench()
    assert sentences(device.sent)["TXT"].text.startswith("u-blox")
    read = sentences(device.sample(FIX))
    assert sorted(read) == ["GGA", "GLL", "GSA", "GSV", "RMC", "VTG"]
    for each in (read["GGA"], read["GLL"], read["RMC"]):
        assert (each.lat, each.lon) == pytest.approx(PLACE[:2], abs=1e-7)
        assert (each.time.hour, each.time.minute, each.time.second) == (TIME.hour, TIME.minute, TIME.second)
        assert each.time.microsecond == 120_000
    assert read["RMC"].date == TIME.date()
    assert (read["RMC"].status, read["RMC"].posMode, read["GGA"].quality) == ("A", "A", 1)
    assert read["GGA"].sep == 22.4
    assert read["GGA"].alt == pytest.approx(2.5)
    assert read["RMC"].spd * 1852 / 3600 == pytest.approx(3.0, abs=0.3)
    assert read["VTG"].sogk / 3.6 == pytest.approx(3.0, abs=0.3)
    assert read["VTG"].cogt == pytest.approx(53.13, abs=5.0)
    used = read["GGA"].numSV
    assert used == read["GSV"].numSV
    assert 6 <= used <= 12
    assert read["GSA"].navMode == 3
    assert pytest.approx(read["GGA"].HDOP) == read["GSA"].HDOP


def test_pvt_satellites_and_dilutions_agree_with_the_sentences() -> None:
    device = bench()
    for number in (0x04, 0x07, 0x20, 0x35, 0x61):
        group = UBXMessage("CFG", "CFG-MSG", SET, payload=bytes((1, number, 1)))
        (answer,) = messages(device.ask(group.serialize()))
        assert (answer.identity, answer.clsID, answer.msgID) == ("ACK-ACK", 6, 1)
    read = {each.identity: each for each in messages(device.sample(FIX))}
    pvt = read["NAV-PVT"]
    assert (pvt.lat, pvt.lon) == pytest.approx(PLACE[:2], abs=1e-7)
    assert (pvt.height, pvt.hMSL) == (24_900, 2_500)
    assert datetime(pvt.year, pvt.month, pvt.day, pvt.hour, pvt.min, pvt.second, tzinfo=timezone.utc) == TIME
    assert pvt.nano == 123_456_789
    # GPS's week began on Sunday, 18 s before UTC's
    second = ((TIME.weekday() + 1) % 7) * 86_400 + TIME.hour * 3600 + TIME.minute * 60 + TIME.second + 18
    assert {each.iTOW for each in read.values()} == {second * 1000 + 123}
    assert read["NAV-TIMEGPS"].leapS == 18
    assert read["NAV-TIMEGPS"].week == (WALL_NS // NS_PER_S + 18 - 315_964_800) // 604_800
    assert (pvt.fixType, pvt.gnssFixOk, pvt.validDate, pvt.validTime, pvt.invalidLlh) == (3, 1, 1, 1, 0)
    assert (pvt.hAcc, pvt.vAcc) == (round(2000 * 2**0.5), 3000)
    assert hypot(pvt.velN / 1e3 - 1.8, pvt.velE / 1e3 - 2.4) < 0.3
    assert pvt.gSpeed == pytest.approx(hypot(pvt.velN, pvt.velE), abs=1.0)
    assert pvt.numSV == read["NAV-SAT"].numSvs == sentences(device.sample(FIX))["GGA"].numSV
    assert pvt.pDOP == read["NAV-DOP"].pDOP
    assert read["NAV-SAT"].svUsed_01 == 1
    assert 0 <= read["NAV-SAT"].azim_01 <= 360


def test_there_is_no_fix_under_water_but_the_time_goes_on() -> None:
    device = bench()
    device.ask(UBXMessage("CFG", "CFG-MSG", SET, payload=b"\x01\x07\x01").serialize())
    device.sample(FIX)
    data = device.sample(NO_FIX)
    read, (pvt,) = sentences(data), messages(data)
    assert (read["RMC"].status, read["RMC"].lat, read["RMC"].spd, read["GGA"].quality) == ("V", "", "", 0)
    assert (read["GGA"].numSV, read["GSV"].numSV, read["GSA"].navMode) == (0, 0, 1)
    assert read["RMC"].date == TIME.date()
    assert read["RMC"].time.second == TIME.second
    assert (pvt.fixType, pvt.gnssFixOk, pvt.invalidLlh, pvt.numSV, pvt.velN) == (0, 0, 1, 0, 0)
    assert pvt.hAcc == 0xFFFFFFFF
    assert messages(device.ask(frame(1, 0x12)))[0].gSpeed == 0
    assert pvt.validTime == 1
    assert pvt.second == TIME.second


def test_values_are_set_asked_for_refused_and_kept_by_layer() -> None:
    device = bench()
    pairs = [("CFG_MSGOUT_UBX_NAV_PVT_UART1", 2), ("CFG_UART1OUTPROT_NMEA", 0)]
    for layer in (SET_LAYER_RAM, SET_LAYER_FLASH):
        (answer,) = messages(device.ask(UBXMessage.config_set(layer, 0, pairs).serialize()))
        assert (answer.identity, answer.clsID, answer.msgID) == ("ACK-ACK", 6, 0x8A)
    asked = UBXMessage.config_poll(POLL_LAYER_RAM, 0, ["CFG_MSGOUT_UBX_NAV_PVT_UART1", "CFG_RATE_MEAS"])
    values, acknowledged = messages(device.ask(asked.serialize()))
    assert (values.CFG_MSGOUT_UBX_NAV_PVT_UART1, values.CFG_RATE_MEAS, acknowledged.identity) == (2, 1000, "ACK-ACK")
    epochs = [messages(device.sample(FIX)) for _ in range(4)]
    assert [[each.identity for each in epoch] for epoch in epochs] == [["NAV-PVT"], [], ["NAV-PVT"], []]
    # what PX4's driver sets at its start
    start = {"CFG_UART1_STOPBITS": 1, "CFG_USBINPROT_UBX": 1, "CFG_NAVSPG_FIXMODE": 3, "CFG_ODO_USE_COG": 0,
             "CFG_ITFM_ENABLE": 0, "CFG_MSGOUT_UBX_MON_RF_UART1": 1, "CFG_NAVSPG_DYNMODEL": 7}  # fmt: skip
    (answer,) = messages(device.ask(UBXMessage.config_set(SET_LAYER_RAM, 0, list(start.items())).serialize()))
    asked = UBXMessage.config_poll(POLL_LAYER_RAM, 0, list(start))
    values, _ = messages(device.ask(asked.serialize()))
    assert (answer.identity, {key: getattr(values, key) for key in start}) == ("ACK-ACK", start)
    for key, value in (("CFG_RATE_MEAS", 5), ("CFG_UART1_BAUDRATE", 300), ("CFG_BDS_USE_GEO_PRN", 1)):
        (answer,) = messages(device.ask(UBXMessage.config_set(SET_LAYER_RAM, 0, [(key, value)]).serialize()))
        assert answer.identity == "ACK-NAK"
    device.ask(UBXMessage.config_set(SET_LAYER_RAM, 0, [("CFG_MSGOUT_UBX_NAV_PVT_UART1", 1)]).serialize())
    device.restart()
    assert device.sent == b""  # no greeting, as there are no sentences
    assert [len(messages(device.sample(FIX))) for _ in range(4)] == [1, 0, 1, 0]


def test_every_key_is_one_that_others_list_with_the_same_size() -> None:
    listed = dict(UBX_CONFIG_DATABASE.values())
    sizes = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8}
    assert all(int(listed[key][1:]) == sizes[key >> 28] for key in defaults())
    names = {key: name for name, (key, _) in UBX_CONFIG_DATABASE.items()}
    ends = {names[first].rpartition("_")[0].rpartition("_")[2] for first in RATES.values()}
    binary, text = "POSLLH STATUS VELNED HW HW2 DOP PVT TIMEGPS SAT EOE", "GGA GLL GSA GSV RMC VTG GST ZDA"
    assert ends == {*binary.split(), *text.split()}


def test_older_messages_set_the_rate_and_report_the_port() -> None:
    device = bench()
    (answer,) = messages(device.ask(UBXMessage("CFG", "CFG-RATE", SET, measRate=200, navRate=1, timeRef=0).serialize()))
    assert answer.identity == "ACK-ACK"
    too_large = UBXMessage("CFG", "CFG-RATE", SET, measRate=200, navRate=1, timeRef=256)
    assert messages(device.ask(too_large.serialize()))[0].identity == "ACK-NAK"
    assert device.sample(FIX) == b""  # it measures itself now, five times a second
    device.scene.present = State((0.0, 0.0, -5.0))
    read = [each for _, each in NMEAReader(BytesIO(device.run(2.05)), validate=1) if each.msgID == "GGA"]
    assert len(read) == 10
    assert [each.quality for each in read] == [0] * 5 + [1] * 5  # a second from surfacing to a fix
    device.scene.present = State((0.0, 0.0, 1.0))
    assert next(each for _, each in NMEAReader(BytesIO(device.run(0.25))) if each.msgID == "GGA").quality == 0
    port, _ = messages(device.ask(UBXMessage("CFG", "CFG-PRT", 2, portID=1).serialize()))
    assert (port.portID, port.baudRate, port.inUBX, port.outNMEA) == (1, 38_400, 1, 1)
    (version,) = messages(device.ask(UBXMessage("MON", "MON-VER", 2).serialize()))
    assert version.swVersion.startswith(b"EXT CORE 4.04")
    assert b"PROTVER=32.01" in version.extension_03


def test_ardupilot_s_driver_ends_its_configuration() -> None:
    """As AP_GPS_UBLOX goes on: it asks, compares, sets and asks again; it does not arm before all agrees."""
    device = bench()
    device.ask(b"\xb5\x62\x06\x01\x03\x00\x01\x06\x01\x12\x4f$PUBX,41,1,0023,0001,230400,0*1E\r\n")
    assert device.sample(FIX) == b""  # sentences are off
    wanted = {(1, 7): 1, (1, 2): 0, (1, 3): 0, (1, 0x12): 0, (1, 0x20): 5, (1, 4): 1, (10, 9): 5, (10, 11): 5}
    (port, _) = messages(device.ask(UBXMessage("CFG", "CFG-PRT", POLL).serialize()))
    assert (port.baudRate, port.outNMEA, port.outUBX) == (230_400, 0, 1)
    for (group, number), rate in wanted.items():
        for tries in range(2):
            answer, _ = messages(device.ask(frame(6, 1, bytes((group, number)))))
            if answer.payload[2 + port.portID] == rate:
                break
            assert tries == 0
            device.ask(frame(6, 1, bytes((group, number, rate))))
    rate = UBXMessage("CFG", "CFG-RATE", SET, measRate=200, navRate=1, timeRef=0)
    assert messages(device.ask(rate.serialize()))[0].identity == "ACK-ACK"
    rate, _ = messages(device.ask(UBXMessage("CFG", "CFG-RATE", POLL).serialize()))
    assert (rate.measRate, rate.navRate, rate.timeRef) == (200, 1, 0)
    engine, _ = messages(device.ask(UBXMessage("CFG", "CFG-NAV5", POLL).serialize()))
    device.ask(frame(6, 0x24, b"\x01\x00\x08" + engine.payload[3:]))
    assert messages(device.ask(UBXMessage("CFG", "CFG-NAV5", POLL).serialize()))[0].dynModel == 8
    systems, _ = messages(device.ask(UBXMessage("CFG", "CFG-GNSS", POLL).serialize()))
    assert (systems.numConfigBlocks, systems.gnssId_01, systems.enable_01) == (1, 0, 1)
    for name in ("CFG-SBAS", "CFG-TP5", "CFG-NMEA", "CFG-GNSS"):
        record, _ = messages(device.ask(UBXMessage("CFG", name, POLL).serialize()))
        changed = record.payload[:-1] + b"\x07"
        for payload, accepted in ((changed, "ACK-ACK"), (changed + b"\0", "ACK-NAK")):
            assert messages(device.ask(frame(6, record.serialize()[3], payload)))[0].identity == accepted
        assert messages(device.ask(UBXMessage("CFG", name, POLL).serialize()))[0].payload == changed
    sent = [each.identity for each in messages(device.run(1.05))]
    assert {name: sent.count(name) for name in set(sent)} == {
        "NAV-PVT": 5, "NAV-DOP": 5, "NAV-TIMEGPS": 1, "MON-HW": 1, "MON-HW2": 1,
    }  # fmt: skip
    for number in (2, 3, 0x12):
        (each,) = messages(device.ask(frame(1, number)))
        assert each.identity in ("NAV-POSLLH", "NAV-STATUS", "NAV-VELNED")


def test_corrections_and_sentences_of_a_client_are_read_over_and_garbage_is_counted() -> None:
    device = bench()
    correction = b"\xd3\x00\x13" + bytes(range(19)) + b"\xb5\x62\x24"  # a sync of UBX within is none
    poll = UBXMessage("MON", "MON-VER", 2).serialize()
    data = correction + b"$EIGNQ,RMC*24\r\n" + poll
    assert len(messages(device.ask(data))) == 1
    assert device.device.malformed == 0
    assert len(messages(b"".join(device.ask(bytes((byte,))) for byte in data))) == 1
    assert len(messages(device.ask(b"\x00\xff" * 9 + poll[:-1] + b"\x00" + poll))) == 1
    assert device.device.malformed == 1
    assert len(messages(device.ask(b"\xb5\x62\x0a\x04\xff\x03" + poll))) == 1  # a cut message delays none


def test_the_sky_has_satellites_everywhere_and_they_rise_and_set() -> None:
    places = [(lat, lon) for lat in (-80.0, -30.0, 0.0, 45.0, 89.0) for lon in (-170.0, 0.0, 95.0)]
    for hour in range(0, 24, 3):
        for latitude, longitude in places:
            above = satellites(latitude, longitude, 0.0, 1.4e9 + 3600.0 * hour)
            assert 5 <= len(above) <= 13
            assert 0.5 < dilutions(above).horizontal < 8.0
    early, late = [{each.number for each in satellites(45.0, 9.0, 0.0, 1.4e9 + t)} for t in (0.0, 4 * 3600.0)]
    assert early != late
    above = satellites(45.0, 9.0, 0.0, 1.4e9)
    again = satellites(45.0, 9.0, 0.0, 1.4e9 + 86_164.0905)  # a sidereal day
    for one, other in zip(above, again, strict=True):
        assert one.elevation == pytest.approx(other.elevation, abs=0.01)
        assert hypot(one.azimuth - other.azimuth) * cos(radians(one.elevation)) < 0.01
