"""Reports of a fleet by modem, byte by byte, and their time slots."""

import math
from itertools import pairwise
from math import inf, nan
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.common.errors import ConfigError
from hil.ros import encoders as ros
from hil.ros import message as ros_message
from hil.ros.fleet import Message, decode_message, encode_message
from hil.scenario.config import load_scenario
from hil.scenario.modem import ModemReport, TdmaSchedule, decode_report, encode_report, modem_of
from hil.scenario.variant import write_variant

SCENARIO = "target_hunting_acoustic"
MS = 1_000_000
metres = st.floats(-2e7, 2e7)
speeds = st.floats(-2.5, 2.5)


@given(st.tuples(metres, metres, st.floats(0.0, 6500.0)), st.tuples(speeds, speeds), st.integers(0, 2**31))
def test_a_report_has_16_bytes_and_centimetre_resolution(
    position: tuple[float, float, float], velocity: tuple[float, float], ms: int
) -> None:
    data = encode_report(ModemReport(position, velocity, ms * MS))
    decoded = decode_report(data)
    assert len(data) == 16
    assert decoded
    assert decoded.position[:2] == pytest.approx(position[:2], abs=0.00501)
    assert decoded.position[2] == pytest.approx(position[2], abs=0.0501)
    assert decoded.velocity == pytest.approx(velocity, abs=0.0101)
    assert decoded.clock_ns == ms * MS


def test_a_report_has_the_expected_bytes() -> None:
    data = encode_report(ModemReport((1.0, -2.0, 3.0), (0.4, -0.4), 1500 * MS))
    assert data == bytes.fromhex("64000000 38ffffff 1e00 14 ec dc050000")


def test_values_out_of_range_are_limited_and_malformed_reports_are_none() -> None:
    decoded = decode_report(encode_report(ModemReport((nan, inf, -4.0), (9.0, -9.0), -5)))
    assert decoded
    assert decoded.position[2] == 0.0
    assert decoded.velocity == pytest.approx((2.54, -2.54))
    assert decoded.clock_ns == 0
    assert decode_report(b"") is None
    assert decode_report(bytes(17)) is None


def test_a_modem_message_is_read_by_ros() -> None:
    data = encode_message(Message("uuv2", b"\x01\x02\x03"))
    fields = ros_message.decode("std_msgs/msg/UInt8MultiArray", data)
    assert fields
    assert fields["data"] == b"\x01\x02\x03"
    assert fields["layout"] == {"dim": [{"label": "uuv2", "size": 3, "stride": 3}], "data_offset": 0}
    for topic in ("modem_tx", "modem_rx"):
        decode = ros.decoder(topic)
        assert decode
        assert decode(data) == Message("uuv2", b"\x01\x02\x03")
    assert decode_message(data[:-1]) is None
    assert decode_message(ros_message.encode("std_msgs/msg/UInt8MultiArray", {"data": b"xyz"})) is None


def test_time_slots_never_overlap() -> None:
    scenario = load_scenario(SCENARIO)
    schedules = [TdmaSchedule(scenario, number) for number in range(4)]
    starts = sorted(schedule.after(time * 10 * MS) for schedule in schedules for time in range(300))
    apart = {later - earlier for earlier, later in pairwise(starts)}
    assert apart == {0, 250 * MS}
    assert [schedule.after(0) for schedule in schedules] == [1000 * MS, 250 * MS, 500 * MS, 750 * MS]
    assert schedules[1].after(250 * MS - 1) == 250 * MS
    assert schedules[1].after(250 * MS) == 1250 * MS


def test_without_slots_reports_are_sent_at_random_times() -> None:
    scenario = load_scenario(SCENARIO, {"modem.slot": 0, "hunting.report_period": 1.0})
    turns = TdmaSchedule(scenario, 0)
    gaps = [turns.after(0) for _ in range(500)]
    assert min(gaps) >= 500 * MS
    assert max(gaps) <= 1500 * MS
    assert math.fsum(gaps) / 500 == pytest.approx(1000 * MS, rel=0.06)
    assert [TdmaSchedule(scenario, number).after(0) for number in (0, 0)] == [gaps[0]] * 2
    assert TdmaSchedule(scenario, 1).after(0) != gaps[0]


def test_the_modem_table_has_the_keys_of_the_modem() -> None:
    acoustic = modem_of(load_scenario(SCENARIO, {"modem.bit_rate": 1000.0, "modem.bounces": 2}))
    assert acoustic.model.airtime_ns(16) == 158 * MS


def test_a_scenario_without_a_modem_table_has_no_modem(tmp_path: Path) -> None:
    scenario = load_scenario(write_variant("target_hunting", str(tmp_path), {}))
    assert scenario.modem is None
    with pytest.raises(ConfigError, match=r"there is no \[modem\]"):
        modem_of(scenario)
