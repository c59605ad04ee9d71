"""Common Data Representation, the bytes of ROS 2 messages: little-endian XCDR1 (OMG DDS-XTypes 1.3, 7.4.1).

A message is a header of four bytes, then its fields. Each field is aligned to its own size, counted from the fifth
byte. If only the lengths of strings vary, `Layout` compiles the whole message into one `struct` for each set of
lengths. `Writer` and `Reader` go field by field, for messages with sequences of strings.
"""

from collections.abc import Callable
from struct import Struct, calcsize, error, pack, unpack_from
from typing import Any, TypeVar

HEADER = b"\x00\x01\x00\x00"  # plain CDR, little-endian, no options
_MAX_COMPILED = 64  # entries of a cache: string lengths come from the network and must not make it grow
_COUNT = Struct("<I")

T = TypeVar("T")


class MalformedError(Exception):
    """Raised for a payload that is not a valid message of its type. `tolerant` catches it."""


def tolerant(decode: Callable[[bytes], T]) -> Callable[[bytes], T | None]:
    """Return a version of `decode` that returns None for an invalid payload, instead of raising MalformedError."""

    def decode_or_none(data: bytes) -> T | None:
        try:
            return decode(data)
        except (MalformedError, error):
            return None

    decode_or_none.__doc__ = decode.__doc__
    return decode_or_none


class Layout:
    """A message of numbers and strings. `fields` are `struct` items ("I", "4d", "72s") or the word "string".

    A string takes two values of the compiled struct: its length and its bytes, both with the terminating zero. The
    first value is always `HEADER`.
    """

    def __init__(self, fields: str) -> None:
        self._fields = fields.split()
        self.strings = self._fields.count("string")
        self._structs: dict[tuple[int, ...], Struct] = {}
        self._named: dict[tuple[str, ...], tuple[Struct, tuple[Any, ...]]] = {}

    def struct(self, *lengths: int) -> Struct:
        """Return the Struct of a message whose strings have these lengths; with fewer, only up to the next length."""
        compiled = self._structs.get(lengths)
        if compiled is None:
            if len(self._structs) >= _MAX_COMPILED:
                self._structs.clear()
            compiled = self._structs[lengths] = Struct(self._format(lengths))
        return compiled

    def named(self, names: tuple[str, ...]) -> tuple[Struct, tuple[Any, ...]]:
        """Return the Struct of a message with these strings, and the values to pack for them."""
        try:
            return self._named[names]
        except KeyError:
            if len(self._named) >= _MAX_COMPILED:
                self._named.clear()
            raw = [zero_terminated(name) for name in names]
            strings = tuple([value for name in raw for value in (len(name), name)])
            compiled = self._named[names] = self.struct(*map(len, raw)), strings
            return compiled

    def unpack(self, data: bytes) -> tuple[Any, ...]:
        """Return the values of a payload, `HEADER` first. Raises MalformedError; use inside `tolerant`."""
        check_header(data)
        lengths: tuple[int, ...] = ()
        for _ in range(self.strings):
            (length,) = _COUNT.unpack_from(data, self.struct(*lengths).size - _COUNT.size)
            if length > len(data):
                raise MalformedError("a string longer than the message")
            lengths += (length,)
        return self.struct(*lengths).unpack_from(data)

    def _format(self, lengths: tuple[int, ...]) -> str:
        """Return the `struct` format, padding included."""
        remaining = list(lengths)
        out = "<4s"
        for field in self._fields:
            item = "I" if field == "string" else field
            # a run of bytes (72s: nine float64, packed elsewhere) needs no alignment: the field before it has that
            out += f"{-(calcsize(out) - len(HEADER)) % calcsize('<' + item[-1])}x{item}"
            if field == "string":
                if not remaining:
                    break
                out += f"{remaining.pop(0)}s"
        return out


class Writer:
    """Build a message field by field; `data` has the bytes so far."""

    def __init__(self) -> None:
        self.data = bytearray(HEADER)

    def numbers(self, code: str, *values: float) -> None:
        """Write values of one `struct` type, with alignment."""
        if values:
            self.data += bytes(-(len(self.data) - len(HEADER)) % calcsize(f"<{code}"))
            self.data += pack(f"<{len(values)}{code}", *values)

    def raw(self, data: bytes, size: int = 1) -> None:
        """Write bytes that are packed values of `size` bytes each, with alignment."""
        self.data += bytes(-(len(self.data) - len(HEADER)) % size)
        self.data += data

    def string(self, text: str) -> None:
        """Write a string with its length."""
        raw = zero_terminated(text)
        self.data += bytes(-len(self.data) % _COUNT.size)  # the header has the size of a count
        self.data += _COUNT.pack(len(raw))
        self.data += raw


class Reader:
    """Read a message field by field. Every method raises MalformedError; use inside `tolerant`."""

    def __init__(self, data: bytes) -> None:
        check_header(data)
        self._data = data
        self._at = len(HEADER)

    def numbers(self, code: str, count: int = 1) -> tuple[Any, ...]:
        """Return the next `count` values of one `struct` type."""
        size = calcsize(f"<{code}")
        if count:
            self._at += -(self._at - len(HEADER)) % size
        return unpack_from(f"<{count}{code}", self._data, self._advance(count * size))

    def count(self) -> int:
        """Return the next unsigned number: how many elements follow.

        Raises MalformedError if that is more than there are bytes left.
        """
        count = int(self.numbers("I")[0])
        if count > len(self._data) - self._at:
            raise MalformedError("fewer elements than announced")
        return count

    def raw(self, count: int) -> bytes:
        """Return the next `count` bytes."""
        start = self._advance(count)
        return bytes(self._data[start : start + count])

    def string(self) -> str:
        """Return the next string."""
        return text(self.raw(self.count()))

    def _advance(self, size: int) -> int:
        """Return the offset of the next `size` bytes, and advance."""
        if size > len(self._data) - self._at:
            raise MalformedError("fewer values than announced")
        start, self._at = self._at, self._at + size
        return start


def zero_terminated(text: str) -> bytes:
    """Return a string as bytes with a terminating zero, without its length."""
    return text.encode(errors="replace") + b"\0"


def text(raw: bytes) -> str:
    """Return the string in bytes from `zero_terminated`; invalid UTF-8 becomes U+FFFD."""
    return raw.rstrip(b"\0").decode(errors="replace")


def check_header(data: bytes) -> None:
    """Check that `data` begins as little-endian plain CDR. Raises MalformedError."""
    if data[:2] != HEADER[:2] or len(data) < len(HEADER):
        raise MalformedError("not little-endian CDR")


def diagonal(size: int, first: float, last: float, third: float | None = None) -> bytes:
    """Return the bytes of a size x size covariance matrix with `first` on diagonal elements 0 to 2, `last` on the rest.

    Element 2 is `third` if that is given.
    """
    key = (size, first, last, third)
    try:
        return _diagonals[key]
    except KeyError:
        if len(_diagonals) >= _MAX_COMPILED:
            _diagonals.clear()
        values = [0.0] * (size * size)
        for axis in range(size):
            values[axis * (size + 1)] = first if axis < 3 else last
        if third is not None:
            values[2 * (size + 1)] = third
        packed = _diagonals[key] = pack(f"<{size * size}d", *values)
        return packed


_diagonals: dict[tuple[int, float, float, float | None], bytes] = {}
