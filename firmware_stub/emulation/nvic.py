"""Interrupt controller: selects the exception that the core takes next (ARMv7-M, B1.5 and B3.4).

Exceptions are named by number: 11 SVCall, 14 PendSV, 15 SysTick, 16 + n interrupt n of the chip.
Not modelled: priority groups (every bit of a priority preempts, as in ST's start-up code).
"""

SVCALL, PENDSV, SYSTICK, FIRST_INTERRUPT = 11, 14, 15, 16
INTERRUPTS = 97  # on the F446, which has the most
NMI = 2
PRIORITY_BITS = 0xF0  # only the upper four bits are implemented
LOWEST_PRIORITY = 0x100  # priority of a program outside of exceptions
ALWAYS_ENABLED = (1 << FIRST_INTERRUPT) - 1
ALL_EXCEPTIONS = (1 << FIRST_INTERRUPT + INTERRUPTS) - 1


class Nvic:
    """Interrupt controller. `next`: exception to take (0: none). `urgent`: it preempts the core unless it is masked."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Reset the controller and all request lines."""
        self.enabled = ALWAYS_ENABLED
        self.pending = 0
        self.active: list[int] = []  # the innermost is last
        self.priorities = [0] * (FIRST_INTERRUPT + INTERRUPTS)
        self.priorities[NMI] = -2
        self._lines = 0
        self._select_next()

    def set_line(self, number: int, asserted: bool) -> None:
        """Set or clear a peripheral's request line. Setting it makes the exception pending."""
        bit = 1 << number
        if asserted:
            if not self._lines & bit:
                self._lines |= bit
                self.pend(bit)
        else:
            self._lines &= ~bit

    def pend(self, bits: int) -> None:
        """Make exceptions pending, one per bit."""
        self.pending |= bits & ALL_EXCEPTIONS
        self._select_next()

    def unpend(self, bits: int) -> None:
        """Clear pending exceptions; an exception with a set line becomes pending again, unless it is active."""
        self.pending = self.pending & ~bits | self._lines & bits & ~self._active_bits()
        self._select_next()

    def enable(self, bits: int, is_enabled: bool) -> None:
        """Enable or disable exceptions, one per bit."""
        self.enabled = (self.enabled | bits if is_enabled else self.enabled & ~bits) & ALL_EXCEPTIONS | ALWAYS_ENABLED
        self._select_next()

    def set_priority(self, number: int, priority: int) -> None:
        """Set a priority: 0 is the most urgent, 0xF0 the least."""
        if number < len(self.priorities):
            self.priorities[number] = priority & PRIORITY_BITS
            self._select_next()

    def enter(self) -> int:
        """Make the next exception active; return its number."""
        number = self.next
        self.pending &= ~(1 << number)
        self.active.append(number)
        self._select_next()
        return number

    def leave(self) -> None:
        """End the innermost active exception; if its line is still set, it becomes pending again."""
        bit = 1 << self.active.pop()
        self.pending |= self._lines & bit
        self._select_next()

    def active_word(self, word: int) -> int:
        """Return a word with one bit for each of 32 interrupts of the chip, set if the interrupt is active."""
        return self._active_bits() >> FIRST_INTERRUPT + 32 * word & 0xFFFF_FFFF

    def _active_bits(self) -> int:
        return sum(1 << number for number in set(self.active))

    def _select_next(self) -> None:
        waiting = self.pending & self.enabled
        if not waiting:
            self.next, self.next_priority, self.urgent = 0, LOWEST_PRIORITY, False
            return
        priorities = self.priorities
        self.next_priority = LOWEST_PRIORITY
        while waiting:
            number = (waiting & -waiting).bit_length() - 1
            waiting &= waiting - 1
            if priorities[number] < self.next_priority:
                self.next, self.next_priority = number, priorities[number]
        running = min([priorities[number] for number in self.active]) if self.active else LOWEST_PRIORITY
        self.urgent = self.next_priority < running
