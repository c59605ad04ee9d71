"""Replies of our MAVLink device to a ground station: commands, acknowledgements, motor tests, manual control."""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common import __version__
from hil.links.contract import ThrusterCommand
from tests.support.links.mavlink_peer import MS, Board, Peer, host_end

ACCEPTED, REJECTED, DENIED, UNSUPPORTED, LONG_ONLY = 0, 1, 2, 3, 7
NEUTRAL = [1500] * 4
# ArduSub's VECTORED frame in part: two horizontal thrusters, one vertical, one for the other way
MIX = [[-1.0, 1.0, 0.0, 1.0], [1.0, -1.0, 0.0, 1.0], [0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 1.0, 0.0]]


class Ground(Peer):
    """A ground station connected to a board."""

    def __init__(self, **settings: Any) -> None:
        super().__init__()
        self.board = Board(**settings)

    def exchange(self, data: bytes) -> list[Any]:
        return self.parse(self.board.take(data))

    def send_command(self, command: int, *params: float) -> int:
        """Send COMMAND_LONG; return the result of its one acknowledgement, which must be addressed to us."""
        replies = self.exchange(self.long(command, *params))
        acks = [m for m in replies if m.get_type() == "COMMAND_ACK"]
        assert [(m.command, m.target_system, m.target_component) for m in acks] == [(command, 255, 190)]
        assert all(m.get_type() != "BAD_DATA" for m in replies)
        return int(acks[0].result)

    def set_servo(self, channel: float, width: float) -> int:
        return self.send_command(dialect.MAV_CMD_DO_SET_SERVO, channel, width)

    def motor_test(self, *params: float) -> int:
        return self.send_command(dialect.MAV_CMD_DO_MOTOR_TEST, *params)

    def manual(self, x: int, y: int, z: int, r: int) -> None:
        self.exchange(self.pack(dialect.MAVLink_manual_control_message(1, x, y, z, r, 0)))


@pytest.fixture
def ground() -> Ground:
    return Ground()


@pytest.fixture
def armed(ground: Ground) -> Ground:
    assert ground.send_command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1.0) == ACCEPTED
    return ground


def test_arming_is_reported_at_once_and_moves_nothing(ground: Ground) -> None:
    answers = ground.exchange(ground.arm())
    assert [m.get_type() for m in answers] == ["COMMAND_ACK", "HEARTBEAT", "SYS_STATUS", "SERVO_OUTPUT_RAW"]
    assert answers[1].base_mode == dialect.MAV_MODE_FLAG_SAFETY_ARMED
    assert (ground.board.stm32.armed, ground.board.pwm_us) == (True, NEUTRAL)


def test_arming_again_changes_nothing_and_disarming_clears_the_pulses(armed: Ground) -> None:
    armed.exchange(Peer(1, 191).servos([1700] * 4))
    assert [m.get_type() for m in armed.exchange(armed.arm())] == ["COMMAND_ACK"]
    assert armed.board.pwm_us == [1700] * 4
    armed.exchange(armed.arm(False))
    assert (armed.board.stm32.armed, armed.board.pwm_us) == (False, NEUTRAL)
    armed.exchange(armed.arm())
    assert (armed.board.stm32.armed, armed.board.pwm_us) == (True, NEUTRAL)


@pytest.mark.parametrize("value", [2.0, -1.0, 0.5, math.nan, math.inf, 1e30])
def test_an_invalid_arming_value_is_denied(ground: Ground, value: float) -> None:
    assert ground.send_command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, value) == DENIED
    assert not ground.board.stm32.armed


@pytest.mark.parametrize(
    ("channel", "width"),
    [
        (0, 1600),
        (5, 1600),
        (1.5, 1600),
        (math.nan, 1600),
        (math.inf, 1600),
        (1, 799),
        (1, 2201),
        (1, -1),
        (1, math.nan),
    ],
)
def test_an_unknown_servo_or_an_invalid_pulse_is_denied(armed: Ground, channel: float, width: float) -> None:
    assert armed.set_servo(channel, width) == DENIED
    assert armed.board.pwm_us == NEUTRAL


def test_two_commands_in_one_read_are_both_executed(armed: Ground) -> None:
    set_servo = dialect.MAV_CMD_DO_SET_SERVO
    armed.exchange(armed.long(set_servo, 1, 1600) + armed.long(set_servo, 2, 1700))
    assert armed.board.pwm_us == [1600, 1700, 1500, 1500]


def test_the_watchdog_disarms_after_a_ground_station_times_out(armed: Ground) -> None:
    armed.set_servo(1, 1800)
    received = armed.parse(armed.board.wait(250))
    assert armed.board.pwm_us == NEUTRAL
    assert [m.system_status for m in received if m.get_type() == "HEARTBEAT"][-1] == dialect.MAV_STATE_CRITICAL
    assert armed.set_servo(1, 1800) == REJECTED


def test_every_command_is_acknowledged(ground: Ground) -> None:
    supported = {400, 183, 209, 512, 520}
    for command in (*range(700), 31_010, 42_700, 65_535):
        result = ground.send_command(command, math.nan, math.nan, math.nan)
        assert (result == UNSUPPORTED) == (command not in supported)


def test_command_int_is_acknowledged_too(ground: Ground) -> None:
    message = dialect.MAVLink_command_int_message(1, 1, 0, 400, 0, 0, 1.0, 0.0, 0.0, 0.0, 0, 0, 0.0)
    (ack,) = ground.exchange(ground.pack(message))
    assert (ack.get_type(), ack.command, ack.result) == ("COMMAND_ACK", 400, LONG_ONLY)


def test_broadcast_commands_are_executed(ground: Ground) -> None:
    answers = ground.exchange(ground.long(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, system=0, component=0))
    assert answers[0].result == ACCEPTED
    assert ground.board.stm32.armed


@pytest.mark.parametrize("request_version", [(512, 148.0), (520, 1.0)])
def test_the_version_is_reported(ground: Ground, request_version: tuple[int, float]) -> None:
    answers = ground.exchange(ground.long(*request_version))
    (version,) = [m for m in answers if m.get_type() == "AUTOPILOT_VERSION"]
    assert version.capabilities & dialect.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    reported = version.flight_sw_version.to_bytes(4, "big")[:3]
    assert ".".join(map(str, reported)) == ".".join(__version__.split(".")[:3])
    assert ground.send_command(dialect.MAV_CMD_REQUEST_MESSAGE, 30.0) == DENIED


@pytest.mark.parametrize(
    ("axes", "pulses"),
    [
        ((0, 0, 500, 0), [1500, 1500, 1500, 1500]),
        ((1000, 0, 500, 0), [1100, 1900, 1500, 1500]),
        ((0, 500, 500, 0), [1700, 1300, 1500, 1500]),
        ((0, 0, 1000, 0), [1500, 1500, 1100, 1900]),
        ((0, 0, 0, 0), [1500, 1500, 1900, 1100]),
        ((0, 0, 500, -250), [1400, 1400, 1500, 1500]),
        ((1000, 0, 500, 1000), [1500, 1900, 1500, 1500]),  # mixed beyond full: full
        ((0x7FFF, 0x7FFF, 0x7FFF, 0x7FFF), [1500, 1500, 1500, 1500]),
        ((0, 0, -1000, 0), [1500, 1500, 1900, 1100]),
    ],
)
def test_manual_control_is_mixed_to_the_outputs(axes: tuple[int, int, int, int], pulses: list[int]) -> None:
    ground = Ground(mix=MIX)
    ground.exchange(ground.arm())
    ground.manual(*axes)
    assert ground.board.pwm_us == pulses
    ground.exchange(ground.arm(False))
    ground.manual(*axes)
    assert ground.board.pwm_us == NEUTRAL


def test_manual_control_without_a_mix_is_malformed(armed: Ground) -> None:
    armed.manual(1000, 0, 500, 0)
    assert armed.board.pwm_us == NEUTRAL
    assert armed.board.end.counters.malformed == 1


def test_non_finite_actuator_controls_give_no_pulse() -> None:
    board, host = Board(), Peer(1, 191)
    controls = [math.nan, math.inf, -7.0, 0.25] + [0.0] * 12
    board.take(host.pack(dialect.MAVLink_hil_actuator_controls_message(0, controls, 128, 0)))
    assert board.pwm_us == [0, 0, 1100, 1600]
    board.take(host.pack(dialect.MAVLink_hil_actuator_controls_message(0, controls, 0, 0)))
    assert (board.stm32.armed, board.pwm_us) == (False, NEUTRAL)


@pytest.mark.parametrize(
    ("kind", "throttle", "pulse"), [(0, 0, 1100), (0, 50, 1500), (0, 75, 1700), (0, 100, 1900), (1, 1623, 1623)]
)
def test_a_motor_test_ends_after_its_duration(ground: Ground, kind: int, throttle: float, pulse: int) -> None:
    assert ground.motor_test(3, kind, throttle, 2.0) == ACCEPTED
    assert ground.board.pwm_us == [1500, 1500, pulse, 1500]
    assert ground.board.end.deadline_ns == ground.board.clock.now + 50 * MS
    ground.board.wait(1990)
    assert ground.board.pwm_us == [1500, 1500, pulse, 1500], "ten times the watchdog timeout"
    ground.board.wait(10)
    assert (ground.board.pwm_us, ground.board.stm32.armed) == (NEUTRAL, False)
    ground.board.wait(500)
    assert ground.board.stm32.refused == 0


def test_a_motor_test_does_not_prolong_the_commands_of_a_silent_host(armed: Ground) -> None:
    armed.exchange(Peer(1, 191).servos([1700, 1750, 1800, 1650]))
    armed.board.wait(100)
    assert armed.motor_test(2, 1, 1600, 2.0) == ACCEPTED
    assert armed.board.pwm_us == [1500, 1600, 1500, 1500]
    armed.board.wait(1990)
    assert armed.board.pwm_us == [1500, 1600, 1500, 1500], "ten times the watchdog timeout"
    armed.board.wait(10)
    assert (armed.board.pwm_us, armed.board.stm32.armed) == (NEUTRAL, False)
    assert armed.set_servo(1, 1600) == REJECTED, "a new command requires arming again"


def test_our_host_continues_after_a_motor_test(ground: Ground) -> None:
    host, board = host_end(clock=ground.board.clock), ground.board
    for sequence in range(9):
        if sequence == 4:
            assert board.pwm_us == [1700] * 4
            ground.motor_test(2, 1, 1600, 2.0)
            host.feed(board.take())
        host.feed(board.take(host.encode(ThrusterCommand(sequence, True, (1700,) * 4))))
        board.wait(20)
    assert (board.pwm_us, board.stm32.armed) == ([1700] * 4, True)


def test_a_motor_test_without_a_duration_lasts_half_a_second(ground: Ground) -> None:
    for _ in range(5):
        assert ground.motor_test(1, 1, 1600) == ACCEPTED
        ground.board.wait(400)
        assert ground.board.pwm_us[0] == 1600
    ground.board.wait(100)
    assert ground.board.pwm_us == NEUTRAL


def test_any_other_command_ends_a_motor_test(ground: Ground) -> None:
    ground.motor_test(1, 1, 1600, 5.0)
    assert ground.set_servo(2, 1700) == REJECTED, "a test does not arm"
    assert ground.board.pwm_us[0] == 1600, "and a rejected request is no command"
    ground.exchange(Peer(1, 191).servos([1700] * 4))
    assert (ground.board.pwm_us, ground.board.stm32.armed) == (NEUTRAL, False)
    ground.motor_test(1, 1, 1600, 5.0)
    ground.exchange(ground.arm(False))
    assert ground.board.pwm_us == NEUTRAL
    ground.board.wait(5000)
    assert ground.board.pwm_us == NEUTRAL


def test_a_second_motor_test_replaces_the_first(ground: Ground) -> None:
    ground.motor_test(1, 1, 1600, 5.0)
    ground.motor_test(2, 1, 1700, 0.25)
    assert ground.board.pwm_us == [1500, 1700, 1500, 1500]
    ground.board.wait(250)
    assert ground.board.pwm_us == NEUTRAL


def test_an_unserviced_motor_test_is_ended_by_the_watchdog(ground: Ground) -> None:
    ground.motor_test(1, 1, 1600, 5.0)
    for _ in range(4):
        ground.board.clock.now += 60 * MS
        ground.board.end.tick(ground.board.clock.now)  # woken, but not fed
        assert ground.board.end.deadline_ns > ground.board.clock.now, "or the loop would spin"
    ground.board.end.encode(ground.board.stm32.telemetry(ground.board.clock.now))
    ground.board.stm32.tick(ground.board.clock.now)
    ground.board.end.encode(ground.board.stm32.telemetry(ground.board.clock.now))
    assert ground.board.pwm_us == NEUTRAL
    ground.board.wait(500)
    assert ground.board.pwm_us == NEUTRAL, "and it does not come back"


@pytest.mark.parametrize(
    "params",
    [
        (0, 1, 1600, 1), (5, 1, 1600, 1), (1, 2, 1600, 1), (1, 3, 1600, 1), (1, 0, 101, 1), (1, 0, -1, 1),
        (1, 1, 2300, 1), (1, 1, 1600, 31), (1, 1, 1600, -1), (1, 1, 1600, math.nan), (1, 1, 1600, math.inf),
        (1, 1, math.nan, 1), (1, 0, math.nan, 1), (1, 1, 1600, 1, 2),
    ],
)  # fmt: skip
def test_an_invalid_motor_test_is_denied(ground: Ground, params: tuple[float, ...]) -> None:
    assert ground.motor_test(*params) == DENIED
    assert ground.board.pwm_us == NEUTRAL


def test_the_latest_of_several_commanders_takes_effect(armed: Ground) -> None:
    host = Peer(1, 191)
    for i in range(40):
        armed.exchange(host.servos([1550 + i] * 4))
        assert armed.set_servo(1, 1700 + i) == ACCEPTED
        assert armed.board.pwm_us == [1700 + i] + [1550 + i] * 3
    assert armed.board.stm32.refused == 0


def test_requests_for_parameters_missions_and_files_are_answered(ground: Ground) -> None:
    def send_command(message: Any) -> Any:
        (answer,) = ground.exchange(ground.pack(message))
        return answer

    value = send_command(dialect.MAVLink_param_request_list_message(1, 1))
    assert (value.param_id, value.param_value, value.param_count, value.param_index) == ("SYSID_THISMAV", 1.0, 1, 0)
    assert send_command(dialect.MAVLink_param_request_read_message(1, 1, b"", 0)).param_id == "SYSID_THISMAV"
    assert send_command(dialect.MAVLink_param_set_message(1, 1, b"SYSID_THISMAV", 9.0, 9)).param_value == 1.0
    assert ground.exchange(ground.pack(dialect.MAVLink_param_request_read_message(1, 1, b"OTHER", -1))) == []
    for kind in range(3):
        count = send_command(dialect.MAVLink_mission_request_list_message(1, 1, kind))
        assert (count.get_type(), count.count, count.mission_type) == ("MISSION_COUNT", 0, kind)
    wrong = dialect.MAV_MISSION_INVALID_SEQUENCE
    assert send_command(dialect.MAVLink_mission_request_int_message(1, 1, 0, 0)).type == wrong
    assert send_command(dialect.MAVLink_mission_request_message(1, 1, 0, 0)).type == wrong
    assert send_command(dialect.MAVLink_mission_count_message(1, 1, 3, 0)).type == dialect.MAV_MISSION_NO_SPACE
    assert send_command(dialect.MAVLink_mission_count_message(1, 1, 0, 0)).type == dialect.MAV_MISSION_ACCEPTED
    assert send_command(dialect.MAVLink_mission_clear_all_message(1, 1, 0)).type == dialect.MAV_MISSION_ACCEPTED
    for opcode in range(1, 16):
        request = bytes((5, 0, 2, opcode, 0, 0, 0, 0, 0, 0, 0, 0)).ljust(251, b"\0")
        data = bytes(send_command(dialect.MAVLink_file_transfer_protocol_message(0, 1, 1, list(request))).payload)
        assert data[:6] == bytes((6, 0, 2, 129, 1, opcode)), opcode
        assert data[12] == 7
    reply = bytes((5, 0, 2, 128)).ljust(251, b"\0")
    assert ground.exchange(ground.pack(dialect.MAVLink_file_transfer_protocol_message(0, 1, 1, list(reply)))) == []
    assert ground.exchange(ground.pack(dialect.MAVLink_param_request_list_message(9, 1))) == []
