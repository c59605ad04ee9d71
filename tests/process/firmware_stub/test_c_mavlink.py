"""The core in C executes MAVLink commands as its specification in Python does."""

from typing import Any

import pytest

from hil.links.contract import ThrusterCommand, ThrusterTelemetry
from hil.links.protocols import open_protocol
from tests.support.firmware.c_core import Clock, Script, Step, first_difference, run_c, run_python
from tests.support.links.link_contract import uuv_hil

pytest.importorskip("pymavlink")

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.links.mavlink import stream as mavlink_stream
from tests.support.firmware.c_mavlink import KNOWN, mavlink_script


@pytest.fixture
def messages_of_the_core_only(monkeypatch: pytest.MonkeyPatch) -> None:
    known = {number: extra for number, extra in mavlink_stream.CRC_EXTRA.items() if number in KNOWN}
    monkeypatch.setattr(mavlink_stream, "CRC_EXTRA", known)


def without_deadlines(results: list[Any]) -> list[Any]:
    """Return the time at which the twin in Python wakes; it also wakes for ESC readings, which the board has not."""
    return [done._replace(deadline_us=0) for done in results]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.usefixtures("messages_of_the_core_only")
def test_the_core_matches_the_specification(core: str, seed: int) -> None:
    script, clock = mavlink_script(seed, 250), Clock()
    device = open_protocol("mavlink", "device", script.channels, clock=clock)
    c, python = run_c(core, script), run_python(script, device, clock)
    assert first_difference(script, without_deadlines(c), without_deadlines(python)) is None
    assert len({done.pwm_us for done in c}) > 10


def test_the_host_of_the_thruster_link_commands_the_core(core: str) -> None:
    """The host of hil/links arms it, commands it, reads its report, and then stops sending."""
    clock = Clock()
    host = open_protocol("mavlink", "host", 3, clock=clock)
    steps, received = [Step(0, host.tick(0))], []
    wishes = {100: (1600, 1400, 1501), 120: (1600, 1400, 1502), 140: (1600, 0, 1503)}
    for ms in range(20, 600, 20):
        data = host.encode(ThrusterCommand(ms, True, wishes[ms])) if ms in wishes else b""
        steps.append(Step(ms * 1000, data))
        (*_, done) = run_c(core, Script(3, 200_000, steps))
        received += [message for message in host.feed(done.sent) if isinstance(message, ThrusterTelemetry)]
    moving = [t for t in received if t.sequence == 140 and t.armed]
    assert moving[0].pwm_us == wishes[140]
    assert not moving[0].timed_out
    assert (received[-1].timed_out, received[-1].armed, received[-1].watchdog_trips) == (True, False, 1)
    assert received[-1].pwm_us == (1500,) * 3
    assert host.counters.checksum_errors == host.counters.malformed == 0


@pytest.mark.parametrize("width", [800.0, 1500.4, 1500.5, 1501.5, 1501.6, 2200.0, 0.0])
def test_a_servo_is_set_to_the_nearest_microsecond(core: str, width: float) -> None:
    packer = dialect.MAVLink(None, 255, 190)
    arm = dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
    set_servo = dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_DO_SET_SERVO, 0, 2, width, 0, 0, 0, 0, 0)
    first, packer.seq = arm.pack(packer), 1
    (done,) = run_c(core, Script(2, 200_000, [Step(0, first + set_servo.pack(packer))]))
    assert done.pwm_us == (1500, round(width))


def test_reports_use_the_protocol_of_the_last_valid_packet(core: str) -> None:
    clock = Clock()
    host, frames = open_protocol("mavlink", "host", 2, clock=clock), uuv_hil()
    order = ThrusterCommand(1, True, (1600, 1400))
    by_mavlink, by_frame = host.encode(order), frames.encode(order)
    only_pulses = open_protocol("mavlink", "host", 2, clock=clock).encode(order)[-49:]
    steps = [
        Step(0, b""), Step(200_000, by_mavlink), Step(400_000, by_frame), Step(600_000, only_pulses),
        Step(800_000, by_mavlink),
    ]  # fmt: skip
    done = run_c(core, Script(2, 2_000_000, steps))
    assert [each.sent[:1] for each in done] == [b"\xa5", b"\xfd", b"\xa5", b"\xfd", b"\xfd"]
    assert [each.pwm_us for each in done] == [(1500,) * 2, *[(1600, 1400)] * 2, (1500,) * 2, (1600, 1400)]
