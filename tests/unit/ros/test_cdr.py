"""The CDR encoder and decoder, against golden bytes of another implementation and against noise."""

import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.ros.cdr import HEADER, Layout, MalformedError, Reader, Writer, diagonal, text, tolerant, zero_terminated

NAMES = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=30)


def test_every_field_is_aligned_to_its_size_counted_from_the_fifth_byte() -> None:
    layout = Layout("B H string d B f")
    # B at 0, H at 2, length at 4, 3 bytes at 8, d at 16, B at 24, f at 28
    assert layout.struct(3).size == 4 + 32
    data = layout.struct(3).pack(HEADER, 1, 2, 3, b"ab\0", 0.5, 6, 7.0)
    assert data[4:] == b"\x01\0\x02\0\x03\0\0\0ab\0" + bytes(5) + struct.pack("<d", 0.5) + b"\x06\0\0\0\0\0\xe0\x40"


@pytest.mark.parametrize("name", ["", "a", "abc", "abcd", "abcdefg", "ü"])
def test_layout_and_writer_encode_the_same_bytes(name: str) -> None:
    raw = zero_terminated(name)
    writer = Writer()
    writer.numbers("I", 7)
    writer.string(name)
    writer.numbers("d", 0.5, -0.5)
    writer.numbers("B", 255)
    assert bytes(writer.data) == Layout("I string 2d B").struct(len(raw)).pack(HEADER, 7, len(raw), raw, 0.5, -0.5, 255)


@given(NAMES, NAMES, st.lists(st.integers(-(2**63), 2**63 - 1), max_size=9))
def test_the_reader_decodes_what_the_writer_encoded(first: str, second: str, numbers: list[int]) -> None:
    writer = Writer()
    writer.string(first)
    writer.numbers("I", len(numbers))
    writer.numbers("q", *numbers)
    writer.string(second)
    reader = Reader(bytes(writer.data))
    assert reader.string() == first
    assert reader.numbers("q", reader.count()) == tuple(numbers)
    assert reader.string() == second


@given(NAMES, NAMES, st.floats(allow_nan=False))
def test_a_layout_with_two_strings_survives_a_round_trip(first: str, second: str, number: float) -> None:
    layout = Layout("i string string d")
    strings = [zero_terminated(first), zero_terminated(second)]
    lengths = [len(raw) for raw in strings]
    data = layout.struct(*lengths).pack(HEADER, -3, lengths[0], strings[0], lengths[1], strings[1], number)
    _, whole, _, one, _, two, value = layout.unpack(data)
    assert (whole, text(one), text(two), value) == (-3, first, second, number)
    assert layout.unpack(data + b"more") == layout.unpack(data)


def test_every_truncated_message_is_malformed() -> None:
    layout = Layout("i string d")
    data = layout.struct(4).pack(HEADER, 1, 4, b"abc\0", 2.0)
    for end in range(len(data)):
        assert tolerant(layout.unpack)(data[:end]) is None
    assert tolerant(layout.unpack)(data) is not None


@pytest.mark.parametrize("header", [b"", b"\0", b"\0\1\0", b"\0\0\0\0", b"\0\3\0\0", b"\0\7\0\0", b"\1\0\0\0"])
def test_other_encodings_are_malformed(header: bytes) -> None:
    def reader(data: bytes) -> Any:
        return Reader(data).numbers("d")

    assert tolerant(Layout("d").unpack)(header + bytes(8)) is None
    assert tolerant(reader)(header + bytes(8)) is None


def test_a_count_beyond_the_message_is_refused_before_anything_is_allocated() -> None:
    reader = Reader(HEADER + struct.pack("<I", 0xFFFFFFFF) + bytes(8))
    with pytest.raises(MalformedError):
        reader.numbers("q", reader.count())
    with pytest.raises(MalformedError):
        Reader(HEADER + b"\xff\xff\xff\xffabc").string()
    assert tolerant(Layout("string d").unpack)(HEADER + b"\xff\xff\xff\xffabc") is None


def test_the_cache_does_not_grow_with_received_messages() -> None:
    layout = Layout("string B")
    for length in range(1, 1000):
        layout.unpack(HEADER + struct.pack("<I", length) + bytes(length + 1))
    assert len(layout._structs) <= 64


def test_strings_that_are_unterminated_or_not_utf8_are_decoded() -> None:
    assert Reader(HEADER + b"\x02\0\0\0ab").string() == "ab"
    assert Reader(HEADER + b"\0\0\0\0").string() == ""
    assert Reader(HEADER + b"\x03\0\0\0a\xff\0").string() == "a�"
    assert zero_terminated("a\udcff") == b"a?\0"


def test_tolerant_catches_malformed_payloads_only() -> None:
    def broken(data: bytes) -> int:
        return data.missing  # type: ignore[attr-defined, no-any-return]

    with pytest.raises(AttributeError):
        tolerant(broken)(b"")


@pytest.mark.parametrize(("size", "expected"), [(3, [2.0, 2.0, 2.0]), (6, [2.0, 2.0, 2.0, 5.0, 5.0, 5.0])])
def test_a_diagonal_matrix_has_its_values_on_the_diagonal(size: int, expected: list[float]) -> None:
    values = struct.unpack(f"<{size * size}d", diagonal(size, 2.0, 5.0))
    assert list(values[:: size + 1]) == expected
    assert sum(map(abs, values)) == sum(expected)
