"""Each fault does what its key states, as often as stated, and is counted."""

from contextlib import ExitStack

import pytest

from hil.common.clock import NS_PER_S
from hil.common.errors import ConfigError, DeviceError
from hil.common.schema import parse
from hil.links.wires.can_frame import RECORD_SIZE, CanFrame, pack_frame, unpack_frames
from hil.links.wires.faults import Faults, Tally
from hil.links.wires.timer import Timer
from tests.support.links.faulty_wires import can_pair, cross, instant_pair
from tests.support.links.link_contract import EVERY_BYTE, records, wait_readable

CHUNKS = [number.to_bytes(2, "big") * 8 for number in range(2000)]


def send_chunks(opened: ExitStack, faults: Faults, seed: int = 1) -> tuple[list[bytes], Tally]:
    """Return the output of CHUNKS, sent one by one."""
    far, near = instant_pair(opened, faults, seed)
    received = []
    for chunk in CHUNKS:
        assert near.write(chunk) == len(chunk)
        received.append(far.read())
    return received, near.sent


def near_share(count: int, share: float, of: int) -> bool:
    """Return True if `count` of `total` is that share, within five standard deviations."""
    return bool(abs(count - share * of) < 5 * (of * share * (1 - share)) ** 0.5)


class TestDamagedBytes:
    def test_chunks_are_dropped_at_the_stated_rate(self, opened: ExitStack) -> None:
        received, tally = send_chunks(opened, Faults(drop=0.2))
        assert [chunk for chunk in received if chunk] == [CHUNKS[i] for i, chunk in enumerate(received) if chunk]
        assert tally.dropped == received.count(b"")
        assert near_share(tally.dropped, 0.2, len(CHUNKS))

    def test_corruption_flips_one_bit_at_the_stated_rate(self, opened: ExitStack) -> None:
        received, tally = send_chunks(opened, Faults(corrupt=0.01))
        flips = [a ^ b for a, b in zip(b"".join(received), b"".join(CHUNKS), strict=True)]
        assert all(flip.bit_count() <= 1 for flip in flips)
        assert sum(map(bool, flips)) == tally.corrupted_bytes
        assert near_share(tally.corrupted_bytes, 0.01, len(flips))
        assert len(set(flips)) == 9, "each of the eight bits, and none"

    def test_chunks_are_duplicated_at_the_stated_rate(self, opened: ExitStack) -> None:
        received, tally = send_chunks(opened, Faults(duplicate=0.1))
        assert set(received) <= {*CHUNKS, *[chunk + chunk for chunk in CHUNKS]}
        assert sum(len(chunk) == 32 for chunk in received) == tally.duplicated
        assert near_share(tally.duplicated, 0.1, len(CHUNKS))

    def test_reordering_swaps_a_chunk_with_the_next(self, opened: ExitStack) -> None:
        received, tally = send_chunks(opened, Faults(reorder=0.1))
        order = [int.from_bytes(received_at[:2], "big") for received_at in split(b"".join(received), 16)]
        swaps = [i for i in range(len(order) - 1) if order[i] == order[i + 1] + 1]
        assert tally.reordered - len(swaps) in (0, 1), "the very last one has no next"
        assert near_share(tally.reordered, 0.1 / 1.1, len(CHUNKS))
        for i in swaps:
            order[i], order[i + 1] = order[i + 1], order[i]
        assert order == sorted(order)

    def test_a_reordered_chunk_without_a_successor_is_sent_later(self, opened: ExitStack) -> None:
        far, near = instant_pair(opened, Faults(reorder=1.0))
        received, took_ns = cross(near, far, b"alone")
        assert received == b"alone"
        assert took_ns > 0.09 * NS_PER_S

    def test_faults_apply_to_received_bytes(self, opened: ExitStack) -> None:
        far, near = instant_pair(opened, Faults(drop=0.5))
        received = 0
        for chunk in CHUNKS:
            far.write(chunk)
            received += len(near.read()) // len(chunk)
        assert near.received.dropped == len(CHUNKS) - received
        assert near_share(received, 0.5, len(CHUNKS))
        assert near.sent.chunks == 0

    @pytest.mark.parametrize(("direction", "sent", "received"), [("sent", 1, 0), ("received", 0, 1), ("both", 1, 1)])
    def test_faults_apply_to_the_configured_direction(
        self, opened: ExitStack, direction: str, sent: int, received: int
    ) -> None:
        faults = parse({"direction": direction, "drop": 1.0}, Faults, "link.faults")
        far, near = instant_pair(opened, faults)
        near.write(b"down")
        far.write(b"up")
        assert far.read() == (b"" if sent else b"down")
        assert near.read() == (b"" if received else b"up")
        assert (near.sent.dropped, near.received.dropped) == (sent, received)

    def test_the_seed_determines_the_faults(self, opened: ExitStack) -> None:
        faults = Faults(drop=0.1, corrupt=0.02, duplicate=0.1, reorder=0.1)
        first, again, other = (send_chunks(opened, faults, seed)[0] for seed in (5, 5, 6))
        assert first == again
        assert first != other

    def test_faults_of_one_direction_do_not_depend_on_the_other(self, opened: ExitStack) -> None:
        single = send_chunks(opened, Faults(drop=0.5))[0]
        far, near = instant_pair(opened, Faults(drop=0.5))
        received = []
        for chunk in CHUNKS:
            far.write(b"up")
            near.read()
            near.write(chunk)
            received.append(far.read())
        assert received == single


class TestLostWire:
    def test_a_device_can_be_unplugged_and_plugged_in_again(self, opened: ExitStack) -> None:
        far, near = instant_pair(opened)
        assert not wait_readable(near, 0)
        near.faults = Faults(unplugged=True)
        assert wait_readable(near, 0), "a loop that waits must wake up"
        with pytest.raises(DeviceError, match="host: went away"):
            near.read()
        with pytest.raises(DeviceError, match="host: went away"):
            near.write(b"x")
        near.faults = Faults()
        assert not wait_readable(near, 0)
        near.write(b"x")
        assert far.read() == b"x"

    def test_a_lost_wire_raises_an_error(self, opened: ExitStack) -> None:
        far, near = instant_pair(opened, Faults(delay=0.01))
        far.close()
        assert wait_readable(near)
        with pytest.raises(DeviceError, match="host: went away"):
            near.read()

    def test_bytes_refused_by_the_underlying_wire_are_counted(self, opened: ExitStack) -> None:
        _, near = instant_pair(opened, Faults(duplicate=1.0))
        taken = sum(near.write(bytes(4096)) for _ in range(200))
        assert taken == 200 * 4096, "a delayed byte cannot be refused any more"
        assert near.sent.refused_bytes > 0


class TestOnCan:
    def test_can_frames_stay_whole(self, opened: ExitStack) -> None:
        far, near = can_pair(opened, Faults(drop=0.1, corrupt=0.05, duplicate=0.1, reorder=0.1))
        sent = records(EVERY_BYTE)
        received = b""
        for _ in range(20):
            assert near.write(sent) == len(sent)
            received += far.read()
        frames = list(unpack_frames(received))
        assert len(received) == len(frames) * RECORD_SIZE
        assert {frame.id for frame in frames} <= {frame.id for frame in unpack_frames(sent)}
        assert all(len(frame.data) == 8 for frame in frames)
        tally = near.sent
        assert tally.chunks == 640
        assert 640 - tally.dropped + tally.duplicated - len(frames) in (0, 1), "the very last one may wait for its next"
        assert near_share(tally.dropped, 0.1, 640)
        assert near_share(tally.corrupted_bytes, 0.05, (640 - tally.dropped) * 8)

    def test_a_can_frame_takes_the_time_of_its_bits(self, opened: ExitStack) -> None:
        """An extended frame with 8 bytes, 131 bits, takes 6.55 ms at 20 kbit/s, and a standard empty one 2.35 ms."""
        far, near = can_pair(opened, Faults(baud=20_000))
        for frame, wire_time_ms in ((CanFrame(1, bytes(8)), 6.55), (CanFrame(1, b"", extended=False), 2.35)):
            seconds = cross(near, far, pack_frame(frame))[1] / 1e6
            for _ in range(100):
                assert seconds > wire_time_ms - Timer.MAX_LEAD_NS / 1e6
                if seconds < wire_time_ms + 0.2:  # any further delay is the machine's lateness
                    break
                seconds = cross(near, far, pack_frame(frame))[1] / 1e6
            else:
                pytest.fail(f"never in {wire_time_ms} ms")

    def test_a_paced_bus_refuses_whole_frames(self, opened: ExitStack) -> None:
        _, near = can_pair(opened, Faults(baud=10_000))
        taken = sum(near.write(records(EVERY_BYTE)) for _ in range(30))
        assert 0 < taken < 30 * 512
        assert taken % RECORD_SIZE == 0


class TestSettings:
    def test_faults_are_read_from_a_scenario(self) -> None:
        table = {"baud": 115_200, "delay": "20 ms", "drop": 0.02, "stall_time": 1.5}
        assert parse(table, Faults, "x.toml: link.faults") == Faults(115_200, delay=0.02, drop=0.02, stall_time=1.5)

    def test_a_mistake_is_reported_with_its_key(self) -> None:
        with pytest.raises(ConfigError, match="delay: has the unit 'm'"):
            parse({"delay": "1 m"}, Faults, "x.toml: link.faults")

    def test_faults_can_change_during_a_run(self, opened: ExitStack) -> None:
        far, near = instant_pair(opened)
        near.write(b"one")
        assert far.read() == b"one"
        near.faults = near.faults._replace(drop=1.0)
        near.write(b"two")
        assert far.read() == b""
        near.faults = near.faults._replace(drop=0.0, delay=0.01)
        assert cross(near, far, b"three")[1] > 0.01 * NS_PER_S - Timer.MAX_LEAD_NS
        near.faults = Faults()
        assert near.write(b"four") == 4
        assert far.read() == b"four"
        assert (near.sent.chunks, near.sent.dropped) == (4, 1)


def split(data: bytes, size: int) -> list[bytes]:
    return [data[start : start + size] for start in range(0, len(data), size)]
