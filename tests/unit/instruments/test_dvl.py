"""The Water Linked DVL against its documentation: reports, commands, and what its settings do to the measurement."""

import json
from math import cos, nan, pi, radians, sin
from struct import unpack
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.common.clock import NS_PER_S
from hil.instruments.contract import Client
from hil.instruments.dvl.formats import crc8, encode_pd4, encode_pd6
from hil.instruments.dvl.report import BEAMS, OPTIONS, DvlSettings, Report, Transducer
from hil.instruments.dvl.unit import A50, A125
from sim.rotations import from_euler
from sim.sensors.ranging.dvl import DvlModel
from sim.sensors.samples import DvlSample, OdometrySample
from tests.support.instrument_bench import Bench

TCP = Client(0, "tcp", ("127.0.0.1", 50_000))
REPORT = {
    "time", "vx", "vy", "vz", "fom", "covariance", "altitude", "transducers", "velocity_valid", "status", "format",
    "type", "time_of_validity", "time_of_transmission",
}  # fmt: skip


def fix(velocity: tuple[float, float, float] = (0.5, -0.2, 0.1), altitude: float = 2.0) -> DvlSample:
    return DvlSample(0, velocity, altitude, True)


LOST = DvlSample(0, (nan, nan, nan), nan, False)


def on_tcp(kind: type[Any] = A50, **settings: Any) -> Bench:
    return Bench(kind, DvlModel(rate=15.0), DvlSettings(periodic_cycling_enabled=False, **settings), TCP)


def on_serial(**settings: Any) -> Bench:
    return Bench(A50, DvlModel(rate=15.0), DvlSettings(periodic_cycling_enabled=False, **settings))


def read(data: bytes, kind: str) -> list[Any]:
    return [message for message in map(json.loads, data.split(b"\r\n")[:-1]) if message["type"] == kind]


def command(bench: Bench, name: str, **parameters: Any) -> Any:
    text = json.dumps({"command": name, **({"parameters": parameters} if parameters else {})})
    [response] = read(bench.ask(text.encode() + b"\n"), "response")
    assert (response["response_to"], response["format"]) == (name, "json_v3.2")
    assert bool(response["error_message"]) != response["success"]
    return response


def fly(bench: Bench, sample: DvlSample, seconds: float) -> list[bytes]:
    """Return the reports while the simulated sensor measures at its rate."""
    sent = []
    for _ in range(round(seconds * 15.0)):
        bench.now_ns += NS_PER_S // 15
        sent.append(bench.sample(sample))
    return [data for data in sent if b"velocity" in data or b"wrz" in data]


def report_of(bench: Bench, sample: DvlSample) -> Any:
    return read(fly(bench, sample, 1.5)[-1], "velocity")[-1]


def test_a_report_has_all_fields_and_its_beams_agree_with_its_velocity() -> None:
    report = report_of(on_tcp(), fix())
    assert set(report) == REPORT
    assert report["velocity_valid"] is True
    assert [report[axis] for axis in ("vx", "vy", "vz")] == pytest.approx([0.5, -0.2, 0.1])
    beams = report["transducers"]
    assert [set(beam) for beam in beams] == [{"id", "velocity", "distance", "rssi", "nsd", "beam_valid"}] * 4
    assert [beam["id"] for beam in beams] == [0, 1, 2, 3]
    solved = np.linalg.lstsq(np.array(BEAMS), np.array([beam["velocity"] for beam in beams]), rcond=None)[0]
    assert solved == pytest.approx([0.5, -0.2, 0.1])
    assert [beam["distance"] for beam in beams] == pytest.approx([2.0 / cos(radians(22.5))] * 4)
    assert report["fom"] ** 2 == pytest.approx(max(np.linalg.eigvalsh(np.array(report["covariance"]))))
    assert 0 <= report["time_of_transmission"] - report["time_of_validity"] < 1_000
    assert report["time"] == pytest.approx(1000 / 10, abs=70)


def test_without_lock_the_velocity_is_invalid_and_the_altitude_is_minus_one() -> None:
    bench = on_tcp()
    report_of(bench, fix())
    report = report_of(bench, LOST)
    assert (report["velocity_valid"], report["altitude"], report["vx"]) == (False, -1.0, 0.0)
    assert {(beam["beam_valid"], beam["distance"]) for beam in report["transducers"]} == {(False, -1.0)}
    assert report_of(bench, fix())["velocity_valid"] is True


@pytest.mark.parametrize(
    ("altitude", "rate"), [(0.4, 15.0), (2.0, 10.0), (10.0, 5.5), (20.0, 7.5), (45.0, 3.0), (60.0, 2.0)]
)
def test_the_rate_depends_on_the_altitude(altitude: float, rate: float) -> None:
    assert len(fly(on_tcp(), fix(altitude=altitude), 20.0)) / 20.0 == pytest.approx(rate, rel=0.05)


def test_each_model_has_its_own_reach_and_keeps_its_mode_where_two_overlap() -> None:
    assert [report_of(on_tcp(kind), fix(altitude=60.0))["velocity_valid"] for kind in (A50, A125)] == [False, True]
    bench = on_tcp()
    fly(bench, fix(altitude=0.2), 2.0)
    assert len(fly(bench, fix(altitude=0.5), 10.0)) == pytest.approx(150, abs=3)  # mode 0, though mode 1 begins at 0.3


def test_the_speed_of_sound_scales_and_the_mounting_rotates() -> None:
    bench = on_tcp()
    assert command(bench, "set_config", speed_of_sound=1450, mounting_rotation_offset=90)["success"]
    report = report_of(bench, fix())
    scale = 1450 / 1500
    expected = [0.2 * scale, 0.5 * scale, 0.1 * scale]
    assert [report[axis] for axis in ("vx", "vy", "vz")] == pytest.approx(expected)
    assert report["altitude"] == pytest.approx(2.0 * scale)


def test_a_range_mode_limits_the_search() -> None:
    bench = on_tcp()
    command(bench, "set_config", range_mode="2<=4")
    assert report_of(bench, fix(altitude=1.0))["velocity_valid"] is False
    assert report_of(bench, fix(altitude=5.0))["velocity_valid"] is True


@pytest.mark.parametrize(
    "wrong",
    [
        {"speed_of_sound": 900}, {"speed_of_sound": "1480"}, {"range_mode": "=5"}, {"acoustic_enabled": 1},
        {"mounting_rotation_offset": 361}, {"volume": 3},
    ],
)  # fmt: skip
def test_a_wrong_parameter_is_refused_and_changes_nothing(wrong: dict[str, Any]) -> None:
    bench = on_tcp()
    before = command(bench, "get_config")["result"]
    assert command(bench, "set_config", dark_mode_enabled=True, **wrong)["success"] is False
    assert command(bench, "get_config")["result"] == before


def test_without_acoustics_only_triggered_pings_are_sent() -> None:
    bench = on_tcp()
    command(bench, "set_config", acoustic_enabled=False)
    assert fly(bench, fix(), 3.0) == []
    answers = [command(bench, "trigger_ping")["success"] for _ in range(17)]
    assert answers == [True] * 15 + [False] * 2
    assert len(fly(bench, fix(), 3.0)) == 15


def test_water_tracking_reports_the_water_at_two_hertz() -> None:
    bench = on_tcp()
    command(bench, "set_config", range_mode="wt")
    assert fly(bench, fix(), 1.0) == []
    sent = []
    for _ in range(60):
        bench.now_ns += NS_PER_S // 15
        sent.append(bench.sample(DvlSample(0, (0.3, 0.0, 0.0), nan, True), "dvl_water"))
    reports = [read(data, "velocity_water")[0] for data in sent if b"velocity_water" in data]
    assert len(reports) == pytest.approx(8, abs=1)
    assert (reports[-1]["vx"], reports[-1]["altitude"], reports[-1]["velocity_valid"]) == (0.3, -1.0, True)


def test_configuration_outlives_power_and_a_calibration_takes_its_time() -> None:
    bench = on_tcp()
    command(bench, "set_config", speed_of_sound=1480)
    bench.restart()
    assert command(bench, "get_config")["result"]["speed_of_sound"] == 1480.0
    assert not read(bench.ask(b'{"command": "calibrate_gyro"}\n'), "response")
    [response] = read(bench.run(15.0), "response")
    assert (response["response_to"], response["success"]) == ("calibrate_gyro", True)


def test_dead_reckoning_is_in_the_frame_of_its_last_reset() -> None:
    """Ahead, then a turn to starboard and ahead: along y of the frame in which it began, whatever north is."""
    bench = on_tcp()
    for heading in (0.7, 0.7 + pi / 2.0):
        odometry = OdometrySample(0, (0.0, 0.0, 5.0), from_euler(0.0, 0.0, heading), (0.0,) * 6)
        bench.sample(odometry, "odom")
        if heading == 0.7:
            command(bench, "reset_dead_reckoning")
        fly(bench, fix((1.0, 0.0, 0.0)), 10.0)
    report = read(bench.run(0.3), "position_local")[-1]
    assert set(report) == {"ts", "x", "y", "z", "std", "roll", "pitch", "yaw", "type", "status", "format"}
    assert [report["x"], report["y"], report["z"]] == pytest.approx([10.0, 10.0, 0.0], abs=0.3)
    assert report["yaw"] == pytest.approx(90.0)


def test_a_ping_is_the_documented_lines() -> None:
    assert crc8(b"wru,0,0.070,1.10,-40,-95") == 0x9C
    lines = fly(on_serial(), fix(), 1.5)[-1].split(b"\r\n")[:-1]
    for line in lines:
        text, _, checksum = line.partition(b"*")
        assert crc8(text) == int(checksum, 16)
    words = [line.partition(b"*")[0].decode().split(",") for line in lines]
    counts = [(row[0], len(row)) for row in words if row[0] != "wrp"]
    assert counts == [("wrz", 12), *[("wru", 6)] * 4, ("wrx", 9), ("wrt", 5)]
    assert words[0][1:6] == ["0.500", "-0.200", "0.100", "y", "2.00"]
    assert len(words[0][7].split(";")) == 9


@pytest.mark.parametrize(
    ("asked", "replied"),
    [
        (b"wcv\n", b"wrv,2,7,0"), (b"wcw\r\n", b"wrw,dvl-a50,2.7.1,0x"), (b"wcc\r", b"wrc,1500.00,0.00,y,n,auto,n"),
        (b"wcs,1450,,n,,,\n", b"wra"), (b"wcs,1450\n", b"wr?"), (b"wcs,,,,,wt,\n", b"wra"),
        (b"wcs,900,,,,,\n", b"wrn"), (b"wcs,1450,,maybe,,,\n", b"wr?"), (b"wcs\n", b"wr?"), (b"wcv*00\n", b"wr!"),
        (b"wcx\n", b"wra"), (b"wcr\n", b"wra"), (b"wcp,3\n", b"wra"), (b"wcp,4\n", b"wrn"), (b"hello\n", b"wr?"),
    ],
)  # fmt: skip
def test_a_serial_command_gets_the_documented_reply(asked: bytes, replied: bytes) -> None:
    assert on_serial().ask(asked).startswith(replied)


def test_a_line_that_does_not_end_is_refused() -> None:
    bench = on_serial()
    bench.ask(b"wc")
    assert b"wr?" in bench.run(0.2)
    assert bench.ask(b"wcv\n").startswith(b"wrv")


def test_serial_protocols_change_the_output_and_outlive_power() -> None:
    bench = on_serial()
    for number, begin in ((3, b"wrz"), (2, b":SA"), (6, b"\x7d\x00")):
        bench.ask(b"wcp,%d\n" % number)
        bench.restart()
        bench.device.tick(bench.now_ns)
        sent = []
        for _ in range(3):
            bench.now_ns += NS_PER_S
            sent.append(bench.sample(fix()))
        assert sent[-1].startswith(begin) or begin in sent[-1]
        assert b"wrx" not in sent[-1]


PING = Report(
    100.0, (0.123, -0.42, 2.0), (1e-4,) * 3, 5.32, tuple(Transducer(0.0, d) for d in (1.0, 2.0, 3.0, 4.0)), True,
    1_659_960_378_000_000,
)  # fmt: skip


def test_pd6_is_the_documented_example() -> None:
    assert encode_pd6(PING, DvlSettings(speed_of_sound=1475.0)).decode().split("\r\n") == [
        ":SA, +0.00, +0.00,  0.00",
        ":TS,22080812061800, 0.0, +0.0,   0.0,1475.0,  0",
        ":WI,    +0,    +0,    +0,    +0,V",
        ":WS,    +0,    +0,    +0,V",
        ":WE,    +0,    +0,    +0,V",
        ":WD,       +0.00,       +0.00,       +0.00,   0.00,  0.00",
        ":BI,  +123,  -420, +2000,    +0,A",
        ":BS,  -420,  +123, +2000,A",
        ":BE,    +0,    +0,    +0,V",
        ":BD,       +0.00,       +0.00,       +0.00,   5.32,  0.00",
        "",
    ]


def test_pd4_has_its_fields_where_they_are_documented() -> None:
    data = encode_pd4(PING, DvlSettings())
    assert (len(data), data[0], data[1], unpack("<H", data[2:4])[0]) == (47, 0x7D, 0, 45)
    assert unpack("<3h", data[5:11]) == (123, -420, 2000)
    assert unpack("<4H", data[13:21]) == (300, 100, 400, 200)  # BM1 to BM4 are transducers 3, 1, 4, 2
    assert (*data[35:39], unpack("<H", data[41:43])[0]) == (12, 6, 18, 0, 1500)
    assert unpack("<H", data[45:])[0] == sum(data[:45]) & 0xFFFF
    lost = encode_pd4(PING._replace(is_valid=False), DvlSettings())
    assert unpack("<3h", lost[5:11]) == (-32_768,) * 3


@given(st.recursive(st.none() | st.booleans() | st.floats() | st.text(max_size=5), st.lists, max_leaves=5))
def test_no_value_of_a_parameter_upsets_a_dvl(value: Any) -> None:
    bench = on_tcp()
    for message in (value, {"command": value}, {"command": "set_config", "parameters": value}):
        bench.ask(json.dumps(message).encode() + b"\n")
    for key in OPTIONS:
        command(bench, "set_config", **{key: value})
    config = command(bench, "get_config")["result"]
    assert 1000.0 <= config["speed_of_sound"] <= 2000.0
    assert 0.0 <= sin(radians(config["mounting_rotation_offset"]) / 2.0) <= 1.0
