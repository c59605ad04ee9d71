"""Conversion between a message and the numbers of its frame, for a given number of thrusters."""

import struct
from collections.abc import Callable, Iterator, Sequence
from operator import itemgetter
from typing import Any, NamedTuple

from hil.links.contract import PWM_NEUTRAL_US, Message, ThrusterCommand, ThrusterTelemetry
from hil.links.frame.layout import (
    BYTE_ORDERS,
    TYPES,
    Field,
    FrameLayout,
    MessageLayout,
    Other,
    fields_size,
    limits,
    type_size,
    unrolled,
)

Kind = type[ThrusterCommand] | type[ThrusterTelemetry]
SATURATING = ("pwm_us", "age_us")  # the other numbers are counters, which wrap
DEFAULTS = {"armed": True, "timed_out": False, "pwm_us": ()}  # values of fields that the frame lacks; for others 0


class Line(NamedTuple):
    """Linear scaling, quantity = gain * number + bias; numbers on the wire are limited to `low` and `high`."""

    gain: float
    inverse: float  # 1 / gain
    bias: float
    low: float
    high: float
    is_whole: bool

    def number(self, quantity: float) -> float:
        """Return the number nearest to `quantity`."""
        number = (quantity - self.bias) * self.inverse
        return min(max(round(number) if self.is_whole else number, self.low), self.high)

    def quantity(self, number: float) -> int:
        """Return the rounded quantity. Raises ValueError or OverflowError for a number that is not finite."""
        return round(self.gain * number + self.bias)


class Body:
    """Encoder and decoder for the numbers of a message's `fields`, without those in its first `constant_bytes`.

    With `kind` None the message carries no thrusters. `packer` packs the numbers of `pack` and `template`.
    """

    def __init__(
        self, layout: FrameLayout, message: MessageLayout | Other, kind: Kind | None, channels: int, constant_bytes: int
    ) -> None:
        rows = list(numbers_of(layout, message, channels))
        while constant_bytes > 0:
            constant_bytes -= type_size(rows.pop(0)[0].type)
        self.fields = [field for field, _, _ in rows]
        self.packer = struct.Struct(
            BYTE_ORDERS[layout.byte_order] + "".join(TYPES[field.type] for field in self.fields)
        )
        self.template: tuple[float, ...] = tuple([value or field.value or 0 for field, _, value in rows])
        constants = {place: value for place, (_, _, value) in enumerate(rows) if value is not None}
        self._constants, self._constants_of = tuple(constants.values()), _picker(tuple(constants))
        self._neutral = [PWM_NEUTRAL_US] * channels
        if kind:
            self._build_tables(kind)

    def _build_tables(self, kind: Kind) -> None:
        """Build the tables that convert between the numbers of the frame and the fields of the message in one step."""
        self._kind = kind
        names = [field.name for field in self.fields]
        lines = {field.name: _line(field) for field in self.fields}
        known = [(names.index(name), kind._fields.index(name), lines[name]) for name in kind._fields if name in names]
        single = [row for row in known if kind._fields[row[1]] != "pwm_us"]
        self._lined = [(place, index, line) for place, index, line in single if line]
        swapped = list(range(len(names) + len(kind._fields)))  # numbers, then values; those in `single` are swapped
        for place, index, _ in single:
            swapped[place], swapped[len(names) + index] = len(names) + index, place
        self._numbers_of = _picker(swapped[: len(names)])  # picks from template + message
        self._values_of = _picker(swapped[len(names) :])  # picks from numbers + defaults
        self._flags = names.index("flags") if "flags" in names else 0
        bits = self.fields[self._flags].bits._asdict() if "flags" in names else {}
        self._bits = [
            (1 << bit, kind._fields.index(n)) for n, bit in bits.items() if bit is not None and n in kind._fields
        ]
        self._has_armed_bit = kind is ThrusterTelemetry or bits.get("armed") is not None
        pulses = [place for place, name in enumerate(names) if name == "pwm_us"]
        step = pulses[1] - pulses[0] if len(pulses) > 1 else 1
        self._pulses = slice(pulses[0], pulses[-1] + 1, step)
        self._pulse_index, self._pulse_line = kind._fields.index("pwm_us"), lines["pwm_us"]
        self._unset: tuple[Any, ...] = tuple([DEFAULTS.get(name, 0) for name in kind._fields])

    def pack(self, message: Message) -> bytes:
        """Return the packed numbers of `message`; numbers out of range wrap if they are counters, else are limited."""
        values: tuple[Any, ...] = message
        numbers = list(self._numbers_of(self.template + values))
        for place, index, line in self._lined:
            numbers[place] = line.number(values[index])
        for mask, index in self._bits:
            if values[index]:
                numbers[self._flags] += mask
        pulses: Sequence[float] = message.pwm_us
        if not (message.armed or self._has_armed_bit):
            pulses = self._neutral
        if self._pulse_line:
            pulses = [self._pulse_line.number(width) for width in pulses]
        numbers[self._pulses] = pulses
        try:
            return self.packer.pack(*numbers)
        except struct.error:
            return self.packer.pack(*[_fitted(v, field) for v, field in zip(numbers, self.fields, strict=True)])

    def message(self, numbers: tuple[Any, ...]) -> Message | None:
        """Return the message of unpacked numbers; None if one of the constants is wrong."""
        if self._constants_of(numbers) != self._constants:
            return None
        values = list(self._values_of(numbers + self._unset))
        flags = numbers[self._flags]
        for mask, index in self._bits:
            values[index] = flags & mask != 0
        values[self._pulse_index] = numbers[self._pulses]
        try:
            for place, index, line in self._lined:
                values[index] = line.quantity(numbers[place])
            if self._pulse_line:
                values[self._pulse_index] = tuple([self._pulse_line.quantity(n) for n in numbers[self._pulses]])
        except (ValueError, OverflowError):  # nan or inf
            return None
        return self._kind(*values)

    def matches_constants(self, numbers: tuple[Any, ...]) -> bool:
        """Return whether the constants among the numbers are right."""
        return self._constants_of(numbers) == self._constants


def numbers_of(
    layout: FrameLayout, message: MessageLayout | Other, channels: int
) -> Iterator[tuple[Field, int, int | None]]:
    """Yield every number between sync and checksum: its field, its index in a list, and its value if constant."""
    behind = fields_size(message.fields, channels)
    for field in layout.header:
        yield field, 0, _constant(field, message.id, channels, behind)
    interleaved = isinstance(message, MessageLayout) and message.interleaved
    for field, channel in unrolled(message.fields, channels, interleaved):
        behind -= type_size(field.type)
        yield field, channel, _constant(field, message.id, channels, behind)


def _constant(field: Field, message_id: int | None, channels: int, behind: int) -> int | None:
    """Return the constant value of a field, or None. `behind` is the number of bytes that a length field counts."""
    if field.name == "id":
        return message_id
    if field.name in ("length", "count"):
        return (behind if field.name == "length" else channels) + field.adds
    return None if field.extra else field.value


def _picker(indices: Sequence[int]) -> Callable[[tuple[Any, ...]], tuple[Any, ...]]:
    """Return a function that picks the items at these indices, always as a tuple."""
    if len(indices) > 1:
        return itemgetter(*indices)
    start = indices[0] if indices else 0
    return itemgetter(slice(start, start + len(indices)))


def _line(field: Field) -> Line | None:
    """Return the scaling of a field; None if the number is the quantity itself."""
    gain, bias = field.line
    if (gain, bias) == (1.0, 0.0) and field.type != "f32":
        return None
    return Line(gain, 1.0 / gain, bias, *limits(field.type), field.type != "f32")


def _fitted(number: float, field: Field) -> float:
    """Return a number that fits into its field: pulse widths and ages are limited, counters wrap."""
    low, high = limits(field.type)
    if field.name in SATURATING or field.type == "f32":
        return min(max(number, low), high)
    return (number - low) % (high - low + 1) + low
