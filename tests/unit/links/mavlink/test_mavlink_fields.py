"""Every field of the messages that both ends send, read by pymavlink."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.links.contract import ThrusterCommand, ThrusterTelemetry
from tests.support.links.mavlink_peer import Clock, Peer, device_end, host_end

PULSES = (1100, 1300, 1499, 0)
OFF = [0] * 12
CLOCK = Clock(1_234_567_000)
REPORT = ThrusterTelemetry(0, True, False, PULSES, 0, 65_535, 258, 3)


def assert_same(data: bytes, *wanted: Any) -> None:
    found = Peer().parse(data)
    assert [message.get_type() for message in found] == [message.get_type() for message in wanted]
    for message, expected in zip(found, wanted, strict=True):
        assert message.to_dict() == expected.to_dict()


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("servo_output_raw", dialect.MAVLink_servo_output_raw_message(1_234_567, 0, *PULSES, *OFF)),
        (
            "rc_channels_override",
            dialect.MAVLink_rc_channels_override_message(1, 1, 1100, 1300, 1499, 1, *[0xFFFF] * 14),
        ),
    ],
)  # fmt: skip
def test_a_command_has_its_fields(command: str, message: Any) -> None:
    host = host_end(command=command, clock=CLOCK)
    assert_same(host.encode_settled(ThrusterCommand(1, True, PULSES)), message)


def test_arming_and_the_hosts_heartbeat_have_their_fields() -> None:
    host = host_end(clock=CLOCK)
    assert_same(host.tick(0), dialect.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
    packets = host.encode(ThrusterCommand(1, True, PULSES))
    arming = dialect.MAVLink_command_long_message(1, 1, 400, 0, 1.0, *[0.0] * 6)
    assert_same(packets, arming, dialect.MAVLink_servo_output_raw_message(1_234_567, 0, *PULSES, *OFF))


@pytest.mark.parametrize(
    ("report", "mode", "state", "enabled"),
    [
        (REPORT, 128, 4, 32_768),
        (REPORT._replace(armed=False), 0, 3, 0),
        (REPORT._replace(armed=False, timed_out=True), 0, 5, 0),
    ],
)
def test_a_report_has_its_fields(report: ThrusterTelemetry, mode: int, state: int, enabled: int) -> None:
    status = dialect.MAVLink_sys_status_message(
        32_768, enabled, 32_768 if not report.timed_out else 0, 0, 65_535, -1, -1, 0, 258, 3, 65_535, 0, 0
    )
    assert_same(
        device_end(clock=CLOCK).encode(report),
        dialect.MAVLink_heartbeat_message(12, 0, mode, 0, state, 3),
        status,
        dialect.MAVLink_servo_output_raw_message(1_234_567, 0, *PULSES, *OFF),
    )


def test_replies_have_their_fields() -> None:
    device, peer = device_end(clock=CLOCK), Peer(1, 191)
    device.feed(peer.arm())
    assert_same(device.replies(), dialect.MAVLink_command_ack_message(400, 0, 0, 0, 1, 191))
    device.feed(peer.pack(dialect.MAVLink_timesync_message(0, 42)))
    assert_same(device.replies(), dialect.MAVLink_timesync_message(1_234_567_000, 42))


def test_the_age_of_a_command_counts_from_the_first_report_that_shows_it() -> None:
    clock = Clock(5_000_000)
    host, device = host_end(clock=clock), device_end(clock=clock)
    ages = []
    for number, after_us in enumerate((0, 300, 0, 200)):
        if after_us == 0:
            host.encode(ThrusterCommand(number, True, (1100 + number, *PULSES[1:])))
        clock.now += after_us * 1000 + 1_000_000
        shown = REPORT._replace(pwm_us=(1100 + number - (after_us > 0), *PULSES[1:]))
        found = host.feed(device.encode(shown))
        ages += [message.age_us for message in found if isinstance(message, ThrusterTelemetry)]
    assert ages == [0, 1300, 0, 1200]


def test_reports_of_others_and_late_figures_are_ignored() -> None:
    host, device, other = host_end(clock=CLOCK), device_end(clock=CLOCK), Peer(1, 9)
    servos = dialect.MAVLink_servo_output_raw_message
    assert host.feed(other.pack(servos(9, 0, *PULSES, *OFF)) + Peer(1, 1).pack(servos(9, 1, *PULSES, *OFF))) == []

    def errors(sender: Peer, number: int, count: int) -> int:
        sender.mavlink.seq = number
        host.feed(sender.pack(dialect.MAVLink_sys_status_message(0, 0, 0, 0, 0, -1, -1, 0, count, 0, 0, 0, 0)))
        (report,) = host.feed(Peer(1, 1).pack(servos(9, 0, *PULSES, *OFF)))
        assert isinstance(report, ThrusterTelemetry)
        return report.errors

    rows = ((40, 5), (39, 4), (24, 4), (23, 6), (22, 5), (200, 7))  # by up to 16 late; others come after a restart
    assert [errors(Peer(1, 1), *row) for row in rows] == [5, 5, 5, 6, 6, 7]
    assert errors(other, 201, 99) == 7
    for end, message in ((device, REPORT), (host, ThrusterCommand(1, True, PULSES))):
        with pytest.raises(ValueError, match="3"):
            end.encode(message._replace(pwm_us=PULSES[:3]))
