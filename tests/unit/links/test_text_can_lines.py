"""Frames of CAN in streams of text: noise between them, limits of their fields."""

from collections.abc import Callable

from hypothesis import given
from hypothesis import strategies as st

from hil.links.contract import Wire
from hil.links.wires.can_frame import CanFrame, unpack_frames
from hil.links.wires.text_can_bus import SlcanWire, SocketcandWire
from tests.support.links.can_bench import MemoryBus

STANDARD = CanFrame(0x7FF, b"\x01\x02\x03", extended=False)
EXTENDED = CanFrame(0x1FFF_FFFF, bytes(range(8)))


def read_frames(kind: Callable[[Wire], Wire], *chunks: bytes) -> list[CanFrame]:
    """Return the frames that a wire reads from a line that gets the chunks one by one."""
    line, received = MemoryBus().wire(), b""
    wire = kind(line)
    for line.unread in chunks:
        received += wire.read()
    assert len(received) % 16 == 0
    return unpack_frames(received)


class TestSlcan:
    @given(
        noise=st.lists(st.one_of(st.binary(max_size=40), st.sampled_from([b"t123", b"T00000FFF8", b"t12381", b"tz"])))
    )
    def test_noise_raises_no_error_and_loses_no_later_frame(self, noise: list[bytes]) -> None:
        later = b"\rtF23", b"\x07T1FFFFFFF8000102030405", b"0607\r"
        assert read_frames(SlcanWire, *noise, *later)[-1] == EXTENDED

    def test_identifiers_have_11_or_29_bits(self) -> None:
        frames = read_frames(SlcanWire, b"t8000\rT200000000\rt7FF0\rT1FFFFFFF0\r")
        assert [(frame.id, frame.extended) for frame in frames] == [(0x7FF, False), (0x1FFF_FFFF, True)]

    def test_a_timestamp_is_ignored(self) -> None:
        assert read_frames(SlcanWire, b"t7FF3010203A1B2\r") == [STANDARD]


class TestSocketcand:
    def test_noise_raises_no_error_and_loses_no_later_frame(self) -> None:
        noise = [
            b"\xff< frame",
            b"< frame 12G 1.0 00 >< frame 123 1.0 0 >< frame FFFFFFFF 1.0 >",
            b"< fra",
            b"< error > ",
        ]
        later = b"< frame 1FFFFFFF 1.5 00010203", b"04050607 >"
        assert read_frames(lambda line: SocketcandWire(line, "can1"), *noise, *later) == [EXTENDED]
