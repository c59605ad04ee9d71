"""What a DroneCAN node does by itself: times, numbers that it gives to others, and what it counts."""

from typing import Any

import pytest

from hil.links.dronecan import types
from hil.links.dronecan.allocation import FOLLOWUP_TIMEOUT_NS, Allocator
from hil.links.dronecan.host import DroneCanHost
from hil.links.dronecan.transfer import END, START, TRANSFER_TIMEOUT_NS, DataType, frame_id, message_key, pack_transfer
from hil.links.dronecan.types import Allocation, EscStatus, NodeStatus
from hil.links.wires.can_frame import CanFrame, pack_frame
from tests.support.links.dronecan_ends import MS, device, host, report, transfers

UID = bytes(range(16))
ANONYMOUS = 24 << 24 | 0x1234 << 10 | types.ALLOCATION.id << 8


def message(kind: DataType, payload: bytes, source: int = 42, number: int = 0) -> bytes:
    return pack_transfer(frame_id(message_key(kind), 16, source), payload, number, kind.seed)


def request(part: bytes, first: bool = False, preferred: int = 0) -> bytes:
    payload = types.pack_allocation(Allocation(preferred, first, part))
    return pack_frame(CanFrame(ANONYMOUS, payload + bytes([START | END])))


def asked(master: DroneCanHost, unique_id: bytes = UID, preferred: int = 0) -> Allocation | None:
    """Return the last answer to a node's three requests."""
    answers = b""
    for start in (0, 6, 12):
        master.feed(request(unique_id[start : start + 6], not start, preferred))
        answers = master.replies()
    found = [types.unpack_allocation(whole.payload) for whole in transfers(answers, types.ALLOCATION)]
    return found[-1] if found else None


def test_the_host_gives_numbers_that_nobody_has() -> None:
    master = host(allocate=True, node_id=30)
    assert asked(master, preferred=30) == Allocation(31, False, UID)
    master.feed(message(types.NODE_STATUS, types.pack_node_status(NodeStatus(1, 0, 0, 0)), source=50))
    assert asked(master, UID[::-1], preferred=50) == Allocation(51, False, UID[::-1])
    assert asked(master, preferred=99) == Allocation(31, False, UID), "as before"
    assert asked(host(), preferred=9) is None
    others = message(types.ALLOCATION, types.pack_allocation(Allocation(0, True, UID[:6])))
    master.feed(others)
    assert master.replies() == b"", "a node with a number asks for none"


def test_the_host_wakes_to_end_an_unfinished_exchange() -> None:
    master = host(allocate=True)
    master.tick(0)
    assert master.deadline_ns == 500 * MS, "ArmingStatus"
    master.feed(request(UID[:6], first=True))
    assert master.deadline_ns == 0
    deadlines = []
    for now_ms in (100, 500, 599, 600):
        master.tick(now_ms * MS)
        deadlines.append(master.deadline_ns // MS)
    assert deadlines == [500, 600, 600, 1000]
    master.replies()
    master.feed(request(UID[6:12]))
    assert master.replies() == b""


@pytest.mark.parametrize(
    ("preferred", "taken", "given"),
    [(0, (), 125), (1, (), 1), (125, (), 125), (126, (), 125), (127, (), 125), (124, (124, 125), 123),
     (60, (60, 61), 62), (60, range(59, 126), 58), (2, range(2, 126), 1), (2, range(1, 126), None)],
)  # fmt: skip
def test_a_number_is_the_preferred_one_or_the_next(preferred: int, taken: tuple[int, ...], given: int | None) -> None:
    allocator = Allocator()
    for number in taken:
        allocator.see(number)
    answers = [allocator.answer(Allocation(preferred, not at, UID[at : at + 6])) for at in (0, 6, 12)]
    assert answers[:2] == [Allocation(0, False, UID[:6]), Allocation(0, False, UID[:12])]
    assert answers[2] == (Allocation(given, False, UID) if given else None)


def test_an_exchange_needs_parts_of_their_size_in_time() -> None:
    allocator = Allocator()

    def answer(part: bytes, first: bool = False) -> bytes | None:
        found = allocator.answer(Allocation(0, first, part))
        return found.unique_id if found else None

    assert answer(UID[:6], True) == UID[:6]
    assert (answer(UID[6:11]), answer(UID[6:12])) == (None, UID[:12])
    assert answer(UID[12:15]) is None
    assert answer(b"newone", True) == b"newone", "a first part begins again"
    allocator.expire(7)
    allocator.expire(6 + FOLLOWUP_TIMEOUT_NS)
    assert answer(b"second") == b"newonesecond"
    allocator.expire(8)
    allocator.expire(8 + FOLLOWUP_TIMEOUT_NS)
    assert answer(b"more") is None
    assert allocator.due_ns > 2**62


def test_a_status_has_uptime_health_and_its_time() -> None:
    end = device()
    end.tick(5_000 * MS)
    statuses = []
    for now_ms in (5_999, 6_000, 8_500, 9_499, 9_500):
        found = transfers(end.tick(now_ms * MS), types.NODE_STATUS)
        statuses += [(now_ms, types.unpack_node_status(one.payload)) for one in found]
        assert end.deadline_ns > now_ms * MS
    assert statuses == [
        (6_000, NodeStatus(1, 0, 0, 0)), (8_500, NodeStatus(3, 0, 0, 0)), (9_500, NodeStatus(4, 0, 0, 0)),
    ]  # fmt: skip


def test_reports_of_the_hosts_own_thrusters_are_taken() -> None:
    master, end = host(2, esc_index=3), device(2, esc_index=3)
    assert [master.motor_values(thruster) for thruster in range(3)] == [{}, {}, {}]
    for index in (2, 5):
        status = EscStatus(9, 1.0, 1.0, 1.0, 1, 1, index)
        assert master.feed(message(types.ESC_STATUS, types.pack_esc_status(status), 60 + index)) == []
    assert [master.motor_values(thruster) for thruster in range(-1, 3)] == [{}] * 4
    master.feed(end.encode(report((1700, 1100), errors=7)))
    assert [master.motor_values(thruster) for thruster in range(2)] == [
        {"rpm": 1750, "A": 3.0, "V": 16.0}, {"rpm": -3500, "A": 24.0, "V": 16.0},
    ]  # fmt: skip


def test_the_errors_of_a_report_are_the_most_of_one_controller() -> None:
    master = host(2)
    reports: list[Any] = []
    for errors in ((3, 8), (9, 8), (65_537, 8)):
        for index, count in enumerate(errors):
            status = types.pack_esc_status(EscStatus(count, 1.0, 1.0, 1.0, 0, 1, index))
            reports += master.feed(message(types.ESC_STATUS, status, 60 + index, len(reports)))
    assert [one.errors for one in reports] == [8, 9, 1]


def test_bytes_and_transfers_that_are_none_are_counted() -> None:
    end = device()
    command = message(types.ARMING_STATUS, b"\xff")
    assert end.feed(command + b"12345") == []
    assert end.counters.dropped_bytes == 5
    end = device()
    assert end.feed(message(types.ARMING_STATUS, b"\xff\xff")) == []
    assert end.counters.malformed == 1


@pytest.mark.parametrize("late_ns", [0, 1])
def test_an_unfinished_transfer_ends_by_the_nodes_clock(late_ns: int) -> None:
    end = device()
    end.tick(MS)
    data = message(types.RAW_COMMAND, types.pack_raw_command([100] * 6))
    end.feed(data[:16])
    end.tick(MS + TRANSFER_TIMEOUT_NS + late_ns)
    assert len(end.feed(data[16:])) == (0 if late_ns else 1)


def test_a_nodes_information_has_its_layout() -> None:
    info = types.NodeInfo("ab", UID, (1, 2), (3, 4))
    packed = types.pack_node_info(NodeStatus(258, 2, 3, 772), info)
    assert packed.hex() == "02010000" + "98" + "0403" + "0102" + "00" * 13 + "0304" + UID.hex() + "00" + b"ab".hex()
