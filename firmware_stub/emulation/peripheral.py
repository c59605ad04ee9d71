"""Base classes of the peripherals: registers, time of the next event, counting of clock ticks."""

from typing import ClassVar

from hil.common.clock import NEVER_NS, NS_PER_S


class Time:
    """The chip's clock: simulated nanoseconds since power-up. It does not advance while instructions are executed."""

    __slots__ = ("now_ns",)

    def __init__(self) -> None:
        self.now_ns = 0


class Peripheral:
    """A block of 32-bit registers by offset in bytes. A plain register stores what is written to it.

    `tick` must be called at `due_ns`.
    """

    RESET: ClassVar[dict[int, int]] = {}  # non-zero register values after a reset
    due_ns = NEVER_NS

    def __init__(self) -> None:
        self.registers = dict(self.RESET)

    def reset(self) -> None:
        """Reset the registers."""
        self.registers = dict(self.RESET)
        self.due_ns = NEVER_NS

    def read(self, offset: int) -> int:
        """Return the register at this offset."""
        return self.registers.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        """Write the register at this offset."""
        self.registers[offset] = value

    def tick(self) -> None:
        """Handle the event that is due now."""


class Ticks:
    """Counter of the ticks of a clock with `hz`, from its creation on."""

    __slots__ = ("_hz", "_start_ns", "_time")

    def __init__(self, time: Time, hz: int) -> None:
        self._time = time
        self._hz = hz
        self._start_ns = time.now_ns

    def count(self) -> int:
        """Return the number of whole ticks until now."""
        return (self._time.now_ns - self._start_ns) * self._hz // NS_PER_S

    def instant_ns(self, count: int) -> int:
        """Return the time (ns) of tick `count`, rounded up."""
        return self._start_ns - (-count * NS_PER_S // self._hz)
