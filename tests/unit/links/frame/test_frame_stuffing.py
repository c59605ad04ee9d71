"""Byte stuffing: the published examples, and properties that hold for any bytes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.links.frame.layout import Stuffing
from hil.links.frame.stuffing import Stuffer, open_stuffer

RULES = {
    "cobs": Stuffing("cobs"),
    "slip": Stuffing("slip"),
    "hdlc": Stuffing("hdlc"),
    "xbee": Stuffing("hdlc", also=(0x11, 0x13)),
    "other": Stuffing("hdlc", delimiter=0x00, escape=0x01, xor=0x80),
}
frames = st.one_of(
    st.binary(max_size=40),
    st.lists(st.sampled_from(b"\x00\x01\x7d\x7e\x5d\x5e\xc0\xdb\xdc\xdd\x11\x31"), max_size=40).map(bytes),
    st.builds(lambda a, n, b: a + b"\x55" * n + b, st.binary(max_size=2), st.integers(250, 520), st.binary(max_size=2)),
)


def stuffer(name: str) -> Stuffer:
    return open_stuffer(RULES[name])


# Cheshire and Baker's algorithm on the usual examples (en.wikipedia.org/wiki/Consistent_Overhead_Byte_Stuffing).
@pytest.mark.parametrize(
    ("frame", "stuffed"),
    [
        (b"\x00", "01 01"),
        (b"\x00\x00", "01 01 01"),
        (b"\x00\x11\x00", "01 02 11 01"),
        (b"\x11\x22\x00\x33", "03 11 22 02 33"),
        (b"\x11\x22\x33\x44", "05 11 22 33 44"),
        (b"\x11\x00\x00\x00", "02 11 01 01 01"),
        (bytes(range(1, 255)), "ff " + bytes(range(1, 255)).hex(" ")),
        (bytes(range(255)), "01 ff " + bytes(range(1, 255)).hex(" ")),
        (bytes(range(1, 256)), "ff " + bytes(range(1, 255)).hex(" ") + " 02 ff"),
        (bytes([*range(2, 256), 0]), "ff " + bytes(range(2, 256)).hex(" ") + " 01 01"),
        (bytes([*range(3, 256), 0, 1]), "fe " + bytes(range(3, 256)).hex(" ") + " 02 01"),
    ],
)
def test_cobs_matches_its_published_examples(frame: bytes, stuffed: str) -> None:
    assert stuffer("cobs").stuff(frame).hex(" ") == stuffed
    assert stuffer("cobs").unstuff(bytes.fromhex(stuffed)) == frame


def test_slip_and_hdlc_match_their_rfcs() -> None:
    """Both match the tables of RFC 1055 and RFC 1662."""
    assert [stuffer(name).delimiter for name in ("slip", "hdlc", "other")] == [b"\xc0", b"\x7e", b"\0"]
    assert stuffer("slip").stuff(b"\xc0\xdb\xdc\x01") == b"\xdb\xdc\xdb\xdd\xdc\x01"
    assert stuffer("hdlc").stuff(b"\x7e\x7d\x5e\x11") == b"\x7d\x5e\x7d\x5d\x5e\x11"
    assert stuffer("xbee").stuff(b"\x7e\x11\x13") == b"\x7d\x5e\x7d\x31\x7d\x33"


@pytest.mark.parametrize("name", RULES)
@given(frames)
def test_any_bytes_survive_a_round_trip(name: str, frame: bytes) -> None:
    codec = stuffer(name)
    stuffed = codec.stuff(frame)
    assert codec.delimiter not in stuffed
    assert codec.unstuff(stuffed) == frame
    assert len(stuffed) <= codec.max_stuffed_size(len(frame))


@pytest.mark.parametrize("name", RULES)
@given(frames, st.binary(max_size=30))
def test_noise_between_delimiters_never_hides_a_frame(name: str, frame: bytes, noise: bytes) -> None:
    """A frame is found after any noise; noise never raises, nor fills memory."""
    codec = stuffer(name)
    before = noise.replace(codec.delimiter, b"").rstrip(
        b"\x7d\xdb\x01"
    )  # an escape at its end would belong to the frame
    found = codec.unstuff(before)
    assert found is None or len(found) <= len(before)
    if frame:
        assert frame in codec.frames_at_end(before + codec.stuff(frame), len(frame))
