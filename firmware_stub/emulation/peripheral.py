"""Base classes of the peripherals: registers, an instant of the next action, counting of clock ticks."""

from typing import ClassVar

from hil.common.clock import NEVER_NS, NS_PER_S

WORD = 0xFFFF_FFFF


class Time:
    """The chip's clock: simulated nanoseconds since power-up. Stands still while instructions are executed."""

    __slots__ = ("now_ns",)

    def __init__(self) -> None:
        self.now_ns = 0


class Peripheral:
    """A block of 32-bit registers, by their offset in bytes; plain ones store what is written to them.

    `due_ns` is when `tick` has to be called.
    """

    RESET: ClassVar[dict[int, int]] = {}  # register values after a reset that are not 0
    due_ns = NEVER_NS

    def __init__(self) -> None:
        self.words = dict(self.RESET)

    def reset(self) -> None:
        """Reset the registers."""
        self.words = dict(self.RESET)
        self.due_ns = NEVER_NS

    def read(self, offset: int) -> int:
        """Return the register at this offset."""
        return self.words.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        """Write the register at this offset."""
        self.words[offset] = value

    def tick(self) -> None:
        """Do what is due now."""

    def retime(self) -> None:
        """Adapt to changed clocks of the chip."""


class Ticks:
    """Count of the ticks of a clock of `hz` from the instant it is made."""

    __slots__ = ("_hz", "_start_ns", "_time")

    def __init__(self, time: Time, hz: int) -> None:
        self._time = time
        self._hz = hz
        self._start_ns = time.now_ns

    def count(self) -> int:
        """Return the whole ticks until now."""
        return (self._time.now_ns - self._start_ns) * self._hz // NS_PER_S

    def instant_ns(self, count: int) -> int:
        """Return when that many have passed, to the next whole nanosecond."""
        return self._start_ns - (-count * NS_PER_S // self._hz)
