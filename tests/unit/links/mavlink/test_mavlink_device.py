"""Replies of our MAVLink device to a ground station: commands and acknowledgements."""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.support.links.mavlink_peer import Board, Peer

ACCEPTED, REJECTED, DENIED, UNSUPPORTED = 0, 1, 2, 3
NEUTRAL = [1500] * 4


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
    supported = {400, 183}
    for command in (*range(700), 31_010, 42_700, 65_535):
        result = ground.send_command(command, math.nan, math.nan, math.nan)
        assert (result == UNSUPPORTED) == (command not in supported)


def test_broadcast_commands_are_executed(ground: Ground) -> None:
    answers = ground.exchange(ground.long(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, system=0, component=0))
    assert answers[0].result == ACCEPTED
    assert ground.board.stm32.armed


def test_the_latest_of_several_commanders_takes_effect(armed: Ground) -> None:
    host = Peer(1, 191)
    for i in range(40):
        armed.exchange(host.servos([1550 + i] * 4))
        assert armed.set_servo(1, 1700 + i) == ACCEPTED
        assert armed.board.pwm_us == [1700 + i] + [1550 + i] * 3
    assert armed.board.stm32.refused == 0


def test_a_packet_that_comes_late_is_refused(armed: Ground) -> None:
    host = Peer(1, 191)
    packets = [host.servos([1600 + i] * 4) for i in range(4)]
    for number in (0, 3, 1, 2):
        armed.exchange(packets[number])
    assert armed.board.pwm_us == [1603] * 4
    assert armed.board.stm32.refused == 2


@pytest.mark.parametrize(
    ("system", "component", "taken"),
    [(1, 1, True), (0, 0, True), (0, 1, True), (1, 0, True), (2, 1, False), (1, 2, False)],
)
def test_commands_for_others_are_ignored(armed: Ground, system: int, component: int, taken: bool) -> None:
    override = dialect.MAVLink_rc_channels_override_message(system, component, 1700, *[0xFFFF] * 17)
    assert bool(armed.exchange(armed.pack(override))) == taken
    assert armed.board.pwm_us == [1700 if taken else 1500] + [1500] * 3
    disarm = armed.long(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, system=system, component=component)
    assert bool(armed.exchange(disarm)) == taken
    assert armed.board.stm32.armed != taken


def test_channels_are_overridden_released_or_left() -> None:
    """The first eight are released by 0, the others by 65534; 0 leaves those as they are."""
    ground = Ground(channels=10)
    ground.exchange(ground.arm())
    ground.exchange(Peer(1, 191).servos([1600] * 10))
    for peer, port in ((Peer(2, 191), 0), (Peer(1, 192), 1)):
        assert ground.exchange(peer.servos([1800] * 10, port)) == []
    channels = [0, 0xFFFF, 1700, 0xFFFE, 0xFFFF, 0xFFFF, 0xFFFF, 0, 0, 0xFFFE]
    override = dialect.MAVLink_rc_channels_override_message(1, 1, *channels, *[0] * 8)
    ground.exchange(ground.pack(override))
    assert ground.board.pwm_us == [1500, 1600, 1700, 0, 1600, 1600, 1600, 1500, 1600, 1500]
