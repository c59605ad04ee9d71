"""Frames of CAN in streams of text: noise between them, limits of their fields."""

from hypothesis import given
from hypothesis import strategies as st

from hil.links.contract import Wire
from hil.links.wires.can_frame import CanFrame, unpack_frames
from hil.links.wires.text_can_bus import SlcanWire, SocketcandWire

STANDARD = CanFrame(0x7FF, b"\x01\x02\x03", extended=False)
EXTENDED = CanFrame(0x1FFF_FFFF, bytes(range(8)))


class CannedLine(Wire):
    """A line that reads as it was given, a part at a time, and takes all that is written."""

    def __init__(self, chunks: list[bytes]) -> None:
        self.name = "canned"
        self.chunks = chunks
        self._unread_parts = iter(chunks)

    def fileno(self) -> int:
        return -1

    def close(self) -> None:
        pass

    def read(self) -> bytes:
        return next(self._unread_parts, b"")

    def write(self, data: bytes) -> int:
        return len(data)


class TestSlcan:
    @given(
        noise=st.lists(st.one_of(st.binary(max_size=40), st.sampled_from([b"t123", b"T00000FFF8", b"t12381", b"tz"])))
    )
    def test_noise_raises_no_error_and_loses_no_later_frame(self, noise: list[bytes]) -> None:
        line = CannedLine([*noise, b"\rtF23", b"\x07T1FFFFFFF8000102030405", b"0607\r"])
        wire = SlcanWire(line)
        received = b"".join(wire.read() for _ in line.chunks)
        assert list(unpack_frames(received))[-1] == EXTENDED
        assert len(received) % 16 == 0

    def test_identifiers_have_11_or_29_bits(self) -> None:
        line = CannedLine([b"t8000\rT200000000\rt7FF0\rT1FFFFFFF0\r"])
        frames = unpack_frames(SlcanWire(line).read())
        assert [(frame.id, frame.extended) for frame in frames] == [(0x7FF, False), (0x1FFF_FFFF, True)]

    def test_a_timestamp_is_ignored(self) -> None:
        line = CannedLine([b"t7FF3010203A1B2\r"])
        assert list(unpack_frames(SlcanWire(line).read())) == [STANDARD]


class TestSocketcand:
    def test_noise_raises_no_error_and_loses_no_later_frame(self) -> None:
        noise = [
            b"\xff< frame",
            b"< frame 12G 1.0 00 >< frame 123 1.0 0 >< frame FFFFFFFF 1.0 >",
            b"< fra",
            b"< error > ",
        ]
        wire = SocketcandWire(CannedLine([*noise, b"< frame 1FFFFFFF 1.5 00010203", b"04050607 >"]), "can1")
        received = b"".join(wire.read() for _ in range(9))
        assert unpack_frames(received) == [EXTENDED]
