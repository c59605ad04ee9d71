"""DroneCAN transfers: split into frames, and reassembled from an unreliable bus."""

import random

import pytest

from hil.links.contract import Counters
from hil.links.dronecan.transfer import (
    END,
    START,
    TOGGLE,
    TRANSFER_TIMEOUT_NS,
    Receiver,
    Transfer,
    frame_id,
    message_key,
    pack_transfer,
    service_key,
)
from hil.links.dronecan.types import ALLOCATION, ESC_STATUS, GET_NODE_INFO, RAW_COMMAND
from hil.links.wires.can_frame import CanFrame
from tests.support.links.can_bench import frames, noise

KEY = message_key(ESC_STATUS)
CAN_ID = frame_id(KEY, 8, 42)
PAYLOAD = bytes(range(14))
ANONYMOUS = CanFrame(24 << 24 | 0x1234 << 10 | ALLOCATION.id << 8, b"abcdefg" + bytes([START | END | 5]))


@pytest.fixture
def receiver() -> Receiver:
    made = Receiver(Counters())
    made.kinds = {KEY: ESC_STATUS, message_key(ALLOCATION): ALLOCATION, message_key(RAW_COMMAND): RAW_COMMAND}
    return made


def transfer(transfer_id: int, payload: bytes = PAYLOAD, can_id: int = CAN_ID) -> list[CanFrame]:
    return frames(pack_transfer(can_id, payload, transfer_id, ESC_STATUS.seed))


def received(receiver: Receiver, frames: list[CanFrame], now_ns: int = 0) -> list[bytes]:
    taken = [receiver.feed_frame(frame, now_ns) for frame in frames]
    return [whole.payload for whole in taken if whole is not None]


def counted(receiver: Receiver) -> tuple[int, int]:
    counters = receiver._counters
    return counters.malformed, counters.checksum_errors


@pytest.mark.parametrize("size", range(18))
def test_transfers_of_any_size_survive_a_round_trip(receiver: Receiver, size: int) -> None:
    receiver.kinds[KEY] = ESC_STATUS._replace(max_size=17)
    cut = transfer(3, bytes(range(size)))
    assert len(cut) == (1 if size <= 7 else -(-(size + 2) // 7))
    assert all(len(frame.data) == 8 for frame in cut[:-1])
    assert received(receiver, cut) == [bytes(range(size))]


def test_transfer_ids_wrap_around(receiver: Receiver) -> None:
    for count in range(100):
        payload = bytes([count]) * 14
        assert received(receiver, transfer(count % 32, payload)) == [payload]
    assert counted(receiver) == (0, 0)


def test_transfers_of_two_nodes_and_priorities_may_interleave(receiver: Receiver) -> None:
    mine, other = transfer(3), transfer(3, b"x" * 14, frame_id(KEY, 8, 43))
    mixed = [frame for pair in zip(mine, other, strict=True) for frame in pair]
    assert received(receiver, mixed) == [PAYLOAD, b"x" * 14]
    assert counted(receiver) == (0, 0)


@pytest.mark.parametrize("lost", range(3))
def test_a_lost_frame_loses_only_its_transfer(receiver: Receiver, lost: int) -> None:
    cut = transfer(1)
    assert len(cut) == 3
    del cut[lost]
    later = [frame for number in (2, 3) for frame in transfer(number)]
    assert received(receiver, transfer(0) + cut + later) == [PAYLOAD] * 3
    assert counted(receiver)[0] > 0


@pytest.mark.parametrize("doubled", range(3))
def test_a_duplicated_frame_is_dropped(receiver: Receiver, doubled: int) -> None:
    cut = transfer(1)
    cut.insert(doubled, cut[doubled])
    assert received(receiver, cut + transfer(2)) == [PAYLOAD] * 2
    assert counted(receiver) == (1, 0)


def test_a_duplicated_single_frame_transfer_is_dropped(receiver: Receiver) -> None:
    (frame,) = transfer(1, b"abc")
    assert received(receiver, [frame, frame]) == [b"abc"]
    assert received(receiver, [frame], TRANSFER_TIMEOUT_NS + 1) == [b"abc"], "a node that restarted"
    assert counted(receiver) == (1, 0)


def test_a_wrong_crc_is_counted(receiver: Receiver) -> None:
    for index in range(3):
        cut = transfer(index)
        data = bytearray(cut[index].data)
        data[0] ^= 1
        cut[index] = CanFrame(CAN_ID, bytes(data))
        assert received(receiver, cut) == []
    assert counted(receiver) == (0, 3)
    assert received(receiver, transfer(3)) == [PAYLOAD]


def test_the_crc_depends_on_the_data_type(receiver: Receiver) -> None:
    assert received(receiver, frames(pack_transfer(CAN_ID, PAYLOAD, 0, RAW_COMMAND.seed))) == []
    assert counted(receiver) == (0, 1)


def test_a_wrong_toggle_is_dropped(receiver: Receiver) -> None:
    for place in range(3):
        cut = transfer(2 * place)
        cut[place] = CanFrame(CAN_ID, cut[place].data[:-1] + bytes([cut[place].data[-1] ^ TOGGLE]))
        assert received(receiver, cut) == []
    assert counted(receiver)[0] >= 3
    assert received(receiver, transfer(9)) == [PAYLOAD]


def test_an_unfinished_transfer_expires(receiver: Receiver) -> None:
    first, second, last = transfer(1)
    assert received(receiver, [first, second], 0) == []
    assert received(receiver, [last], TRANSFER_TIMEOUT_NS + 1) == []
    assert received(receiver, transfer(1), TRANSFER_TIMEOUT_NS + 2) == [PAYLOAD]
    assert counted(receiver) == (2, 0)


def test_an_endless_transfer_is_bounded(receiver: Receiver) -> None:
    endless = [CanFrame(CAN_ID, bytes(7) + bytes([START]))]
    endless += [CanFrame(CAN_ID, bytes(7) + bytes([TOGGLE * (place % 2)])) for place in range(1, 1000)]
    assert received(receiver, endless) == []
    (session,) = receiver._sessions.values()
    assert session.payload is not None
    assert len(session.payload) <= ESC_STATUS.max_size + 2
    assert counted(receiver)[0] > 990


def test_malformed_frames_are_counted(receiver: Receiver) -> None:
    assert received(receiver, [CanFrame(CAN_ID, b""), CanFrame(CAN_ID, b"ab" + bytes([START]))]) == []
    assert counted(receiver) == (2, 0)


def test_frames_of_other_types_are_ignored_and_not_counted(receiver: Receiver) -> None:
    other_frames = [
        frame_id(message_key(GET_NODE_INFO) + 8, 8, 42),
        frame_id(service_key(ESC_STATUS, 5, True), 8, 42),
    ]
    for can_id in other_frames:
        assert received(receiver, transfer(1, can_id=can_id)) == []
    assert counted(receiver) == (0, 0)
    assert not receiver._sessions


def test_anonymous_frames_are_received(receiver: Receiver) -> None:
    assert receiver.feed_frame(ANONYMOUS, 0) == Transfer(message_key(ALLOCATION), 0, 5, 24, b"abcdefg")
    for tail in (START, END, START | END | TOGGLE, 0):
        assert receiver.feed_frame(CanFrame(ANONYMOUS.id, b"abc" + bytes([tail])), 0) is None
    assert counted(receiver) == (4, 0)


def test_noise_is_survived_without_growing_memory(receiver: Receiver) -> None:
    sound = [frame for number in range(32) for frame in transfer(number)]
    sound.append(ANONYMOUS)
    source = random.Random(5)
    now_ns = 0
    for record in noise(25_000, sound):
        now_ns += source.randrange(10_000_000)
        for frame in frames(record):
            receiver.feed_frame(frame, now_ns)
    assert len(receiver._sessions) <= len(receiver.kinds) * 127
    assert all(len(session.payload or b"") <= RAW_COMMAND.max_size + 2 for session in receiver._sessions.values())
    assert min(counted(receiver)) > 2
    assert received(receiver, transfer(30), now_ns + 10**10) == [PAYLOAD]
