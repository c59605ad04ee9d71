"""The instruments of the ping protocol, read by Blue Robotics' own client in simulated time."""

import struct
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import pytest
from brping import S500, Ping1D, Ping360, PingMessage, definitions
from hypothesis import given
from hypothesis import strategies as st

from hil.instruments.ping import ping1d, ping360, s500
from hil.instruments.ping.protocol import ACK, NACK, Decoder, Frame, encode
from sim.environment.obstacles import Box
from tests.support.clients.datagrams import HOST, Datagrams
from tests.support.fitted import FLAT

SECOND = 1_000_000_000
WALL = FLAT._replace(depth=200.0, box=(Box(north=15.0, east=0.0, size_north=2.0, size_east=100.0),))


@pytest.fixture(name="sounder")
def a_sounder() -> Iterator[tuple[Datagrams, Ping1D]]:
    bench = Datagrams(ping1d.Ping1D)
    # By default this client mixes the messages of Ping1D and S500, whose numbers are the same.
    client = Ping1D(payload_dict=definitions.payload_dict_ping1d)
    client.iodev = bench
    with bench.clock("brping.device"):
        yield bench, client


@pytest.fixture(name="scanner")
def a_scanner() -> Iterator[tuple[Datagrams, Ping360]]:
    bench = Datagrams(ping360.Ping360, WALL)
    client = Ping360()
    client.iodev = bench
    with bench.clock("brping.device"):
        yield bench, client


@pytest.fixture(name="cerulean")
def a_cerulean() -> Iterator[tuple[Datagrams, S500]]:
    bench = Datagrams(s500.S500)
    client = S500()
    client.iodev = bench
    with bench.clock("brping.s500"):
        yield bench, client


@given(st.lists(st.binary(max_size=40)), st.binary(max_size=200), st.data())
def test_frames_are_found_in_any_pieces_and_noise(noise: list[bytes], payload: bytes, data: Any) -> None:
    frames = [Frame(6, payload, 1, 2), Frame(1300, b"", 0, 255)]
    stream = b"".join(
        b.replace(b"B", b"U") + encode(f) for b, f in zip([*noise[:2], b"", b""][:2], frames, strict=True)
    )
    cut = data.draw(st.integers(0, len(stream)))
    decoder = Decoder()
    assert decoder.read(stream[:cut]) + decoder.read(stream[cut:]) == frames


def test_every_message_of_an_echo_sounder_can_be_read(sounder: tuple[Datagrams, Ping1D]) -> None:
    bench, client = sounder
    assert client.initialize()
    bench.pass_time(3.0)
    read = {name: getattr(client, name)() for name in dir(client) if name.startswith("get_")}
    assert len(read) == 19
    assert all(read.values())
    assert read["get_distance"]["distance"] == pytest.approx(15_000, abs=60)
    assert read["get_distance"]["confidence"] == 100
    profile = read["get_profile"]
    strongest = max(profile["profile_data"])
    at = profile["profile_data"].index(strongest) / 200 * profile["scan_length"]
    assert at == pytest.approx(15_000, abs=300)


def test_settings_of_an_echo_sounder_change_the_measurement(sounder: tuple[Datagrams, Ping1D]) -> None:
    bench, client = sounder
    assert not client.set_range(10_000, 10_000)  # it chooses its range itself until told otherwise
    assert client.set_mode_auto(0)
    assert client.set_range(10_000, 10_000)
    assert client.set_ping_interval(60)
    assert client.set_gain_setting(0)
    assert client.set_ping_enable(1)
    assert client.set_oss_profile_configuration(400, 0, 0)
    assert client.set_device_id(9)
    slower = PingMessage(definitions.PING1D_SET_SPEED_OF_SOUND, payload_dict=definitions.payload_dict_ping1d)
    slower.speed_of_sound = 1_400_000
    bench.send(slower.pack_msg_data())
    bench.pass_time(1.0)
    weak = client.get_profile()
    assert weak["distance"] == pytest.approx(15_000 * 1400 / 1500, abs=60)
    assert (weak["scan_start"], weak["scan_length"], len(weak["profile_data"])) == (10_000, 10_000, 400)
    assert client._src_device_id == 9
    assert bench.facts.memory == {"device_id": 9}
    client.set_gain_setting(3)
    client.set_oss_profile_configuration(400, 1, 1)
    bench.pass_time(1.0)
    assert sum(client.get_profile()["profile_data"]) > 2 * sum(weak["profile_data"])
    client.set_range(0, 5_000)
    bench.pass_time(1.0)
    assert client.get_distance()["confidence"] == 0
    client.set_ping_interval(0)
    client.set_ping_enable(0)
    number = client.get_distance()["ping_number"]
    bench.pass_time(1.0)
    assert client.get_distance()["ping_number"] == number


@pytest.mark.parametrize(
    "send",
    [
        lambda client: client.set_gain_setting(7, verify=False),
        lambda client: client.set_range(0, 999, verify=False),
        lambda client: client.request(2300, 0.1),
        lambda client: client.control_continuous_start(1203),
        lambda client: client.write(encode(Frame(1005, b"\x01\x02"))),
    ],
)
def test_what_the_device_does_not_know_is_refused(sounder: tuple[Datagrams, Ping1D], send: Any) -> None:
    bench, client = sounder
    del bench.log[:]
    send(client)
    assert any(data[4:6] == bytes((NACK, 0)) for data, *_ in bench.log)
    assert not any(data[4:6] == bytes((ACK, 0)) for data, *_ in bench.log)


def test_a_stream_keeps_its_interval_and_its_instant(sounder: tuple[Datagrams, Ping1D]) -> None:
    bench, client = sounder
    client.set_mode_auto(0)
    client.set_ping_interval(100)
    for number in (ping1d.DISTANCE_SIMPLE, ping1d.PROFILE):
        client.control_continuous_start(number)
    bench.pass_time(1.0)
    del bench.log[:]
    bench.pass_time(2.0)
    profiles = [measured for data, _, measured in bench.log if data[4:6] == (1300).to_bytes(2, "little")]
    assert len(profiles) == pytest.approx(20, abs=1)
    assert len(bench.log) == 2 * len(profiles)
    assert {after - before for before, after in pairwise(profiles)} == {SECOND // 10}
    client.control_continuous_stop(ping1d.DISTANCE_SIMPLE)
    client.control_goto_bootloader()
    assert client.get_distance() is None


def test_a_lost_vehicle_leaves_the_last_measurement(sounder: tuple[Datagrams, Ping1D]) -> None:
    bench, client = sounder
    bench.pass_time(3.0)
    bench.scene.present = None
    bench.pass_time(1.0)  # the ping on its way arrives
    last = client.get_distance()
    bench.pass_time(2.0)
    assert client.get_distance() == last


def test_each_setting_of_a_ping360_takes_effect(scanner: tuple[Datagrams, Ping360]) -> None:
    _, client = scanner
    assert client.initialize()
    assert client._src_device_id == 2
    assert client.get_device_data()["data"] == b""
    assert client.get_auto_device_data()["stop_angle"] == 399
    for name, value in {
        "mode": 1, "gain_setting": 1, "angle": 10, "sample_period": 888, "transmit_duration": 50,
        "transmit_frequency": 750, "number_of_samples": 1200,
    }.items():  # fmt: skip
        assert getattr(client.__class__, f"set_{name}")(client, value).message_id == definitions.PING360_DEVICE_DATA
        assert client.get_device_data()[name] == value
    assert client.set_number_of_samples(1201).nack_message == b"number_of_samples out of range"
    wall = client.transmitAngle(200).data  # ahead
    # The wall is 14 m away; 1200 samples of 22.2 us are 20 m.
    assert wall.index(max(wall)) * 20.0 / 1200 == pytest.approx(14.0, abs=0.2)
    assert max(client.transmitAngle(0).data[400:]) < 0.5 * max(wall)
    client.set_gain_setting(0)
    assert sum(client.transmitAngle(200).data) < sum(wall)
    assert client.set_transmit_duration(400).message_id == definitions.PING360_DEVICE_DATA
    client.set_sample_period(80)
    assert client.get_device_data()["transmit_duration"] == 128  # 64 sample periods of 2 us


def test_a_ping360_takes_the_time_of_motor_and_sound(scanner: tuple[Datagrams, Ping360]) -> None:
    bench, client = scanner
    for period, step, seconds in ((888, 1, 0.0514), (2222, 1, 0.094), (88, 10, 0.0823), (2222, 10, 0.1473)):
        client.control_auto_transmit(1, 0, 11, period, 750, 1200, 0, 399, step, 0)
        client.wait_message([definitions.PING360_AUTO_DEVICE_DATA], 4.0)
        began = bench.now_ns
        for _ in range(10):
            client.wait_message([definitions.PING360_AUTO_DEVICE_DATA], 4.0)
        # Measured on a Ping360 over Ethernet: discuss.bluerobotics.com/t/8328
        assert 1e-10 * (bench.now_ns - began) == pytest.approx(seconds, rel=0.05)


def test_a_sector_is_scanned_forth_and_back_until_the_motor_is_off(scanner: tuple[Datagrams, Ping360]) -> None:
    bench, client = scanner
    client.control_auto_transmit(1, 1, 11, 88, 750, 200, 390, 10, 10, 3)
    angles = [client.wait_message([definitions.PING360_AUTO_DEVICE_DATA], 4.0).angle for _ in range(6)]
    assert angles == [390, 0, 10, 0, 390, 0]
    client.control_motor_off()
    assert client.wait_message([definitions.COMMON_ACK], 1.0).acked_id == definitions.PING360_MOTOR_OFF
    del bench.log[:]
    bench.pass_time(1.0)
    assert not bench.log


def test_a_reset_restores_the_settings_and_silences_for_a_while(scanner: tuple[Datagrams, Ping360]) -> None:
    bench, client = scanner
    assert client.initialize()
    client.set_gain_setting(2)
    with pytest.raises(AttributeError):  # this client reads the number back by a message that it does not define
        client.set_device_id(7, 0)
    client.control_reset(1, 0)
    assert client.get_device_data() is None
    bench.pass_time(5.0)
    assert client.get_device_data()["gain_setting"] == 0
    assert client._src_device_id == 7


def test_a_ping360_is_discovered(scanner: tuple[Datagrams, Ping360]) -> None:
    bench, _ = scanner
    bench.send(b"Discovery")
    answer, to, *_ = bench.log[-1]
    lines = answer.decode().split("\r\n")
    assert (lines[0], len(lines), to) == ("SONAR PING360", 5, HOST)
    assert lines[3] == "IP Address:- 127.000.000.001"


def test_an_s500_reports_what_its_parameters_ask_for(cerulean: tuple[Datagrams, S500]) -> None:
    bench, client = cerulean
    assert client.initialize()
    client.control_set_speed_of_sound(1_400_000)
    client.control_set_ping_params(0, 20_000, 3, 100, report_id=s500._PROFILE, chirp=1)
    bench.pass_time(2.0)
    read = {name: getattr(client, name)() for name in dir(client) if name.startswith("get_")}
    assert len(read) == 11
    assert all(read.values())
    assert read["get_altitude"]["altitude_mm"] == pytest.approx(15_000 * 1400 / 1500, abs=60)
    profile = read["get_profile6_t"]
    assert (profile["length_mm"], profile["num_results"], profile["gain_index"]) == (20_000, 1024, 3)
    assert profile["end_ping_hz"] - profile["start_ping_hz"] == 100_000
    powers = struct.unpack("<1024H", profile["pwr_results"])  # which this client leaves as bytes
    levels = [profile["min_pwr_db"] * (1.0 - power / 65_535.0) for power in powers]
    assert levels.index(max(levels)) * 20.0 / 1024 == pytest.approx(14.0, abs=0.4)
    assert min(levels) < -40.0 < -10.0 < max(levels)
    assert read["get_distance2"]["averaged_distance_mm"] == pytest.approx(14_000, abs=60)


def test_an_s500_pings_once_or_finds_its_range_itself(cerulean: tuple[Datagrams, S500]) -> None:
    bench, client = cerulean
    bench.pass_time(1.0)
    assert not bench.log
    client.control_set_ping_params(0, 0, -1, -1, report_id=s500._DISTANCE)
    bench.pass_time(2.0)
    assert [data[4:6] for data, *_ in bench.log] == [b"\x01\x00", s500._DISTANCE.to_bytes(2, "little")]
    client.control_set_ping_params(0, 0, -1, 50, report_id=s500._DISTANCE)
    bench.pass_time(2.0)
    assert client.get_range()["length_mm"] == 20_000
    assert client.get_distance2()["ping_confidence"] == 100
    client.control_set_ping_params(report_id=0)
    bench.pass_time(0.1)  # the ping on its way arrives
    del bench.log[:]
    bench.pass_time(1.0)
    client.control_set_ping_params(report_id=1300)
    assert [data[4:6] for data, *_ in bench.log] == [bytes((NACK, 0))]
