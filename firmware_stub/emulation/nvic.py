"""Interrupt controller: selects the exception that the core takes next (ARMv7-M, B1.5 and B3.4).

Exceptions are named by number: 15 SysTick, 16 + n interrupt n of the chip.
Not modelled: priorities. All exceptions have the same one, as after a reset, so none interrupts another.
"""

SYSTICK, FIRST_INTERRUPT = 15, 16
ALWAYS_ENABLED = (1 << FIRST_INTERRUPT) - 1


class Nvic:
    """Interrupt controller. `next`: exception to take (0: none). `urgent`: it interrupts the program unless masked."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Reset the controller and all request lines."""
        self.enabled = ALWAYS_ENABLED
        self.pending = 0
        self._active = 0  # the exception whose handler runs
        self._lines = 0
        self._select_next()

    def set_line(self, number: int, asserted: bool) -> None:
        """Set or clear a peripheral's request line. Setting it makes the exception pending."""
        bit = 1 << number
        if asserted:
            if not self._lines & bit:
                self._lines |= bit
                self.pend(number)
        else:
            self._lines &= ~bit

    def pend(self, number: int) -> None:
        """Make an exception pending."""
        self.pending |= 1 << number
        self._select_next()

    def enable(self, bits: int) -> None:
        """Enable exceptions, one per bit."""
        self.enabled |= bits
        self._select_next()

    def enter(self) -> int:
        """Make the next exception active; return its number."""
        self._active = self.next
        self.pending &= ~(1 << self._active)
        self._select_next()
        return self._active

    def leave(self) -> None:
        """End the active exception; if its line is still set, it becomes pending again."""
        self.pending |= self._lines & 1 << self._active
        self._active = 0
        self._select_next()

    def _select_next(self) -> None:
        waiting = self.pending & self.enabled
        self.next = (waiting & -waiting).bit_length() - 1 if waiting else 0
        self.urgent = bool(waiting) and not self._active
