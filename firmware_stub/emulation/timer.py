"""Timers 3 and 4 as sources of PWM pulses (RM0090, section 18)."""

from collections.abc import Callable
from typing import ClassVar

from firmware_stub.emulation.peripheral import Peripheral
from hil.common.clock import now_ns

CR1, CCMR1, CCER, PSC, ARR, CCR1, CCR4 = 0x00, 0x18, 0x20, 0x28, 0x2C, 0x34, 0x40
CEN = 1
PWM_MODE_1 = 6
US_PER_S = 1_000_000


class Timer(Peripheral):
    """A timer with up to four outputs; `clock_hz` returns its input frequency.

    Not modelled: the counter, interrupts, and all modes but PWM mode 1. New settings take effect at once, not in the
    next period.
    """

    RESET: ClassVar[dict[int, int]] = {ARR: 0xFFFF}

    def __init__(self, clock_hz: Callable[[], int]) -> None:
        super().__init__()
        self._clock_hz = clock_hz
        self.width_set_ns = 0  # monotonic time, not simulated, of the program's last write of a pulse width

    def pulse_us(self, channel: int) -> int:
        """Return the rounded width (us) of the pulses on an output, 0 to 3; 0 without pulses."""
        registers = self.registers
        if not registers.get(CR1, 0) & CEN or not registers.get(CCER, 0) >> 4 * channel & 1:
            return 0
        mode = registers.get(CCMR1 + 4 * (channel // 2), 0) >> 8 * (channel % 2)
        width = registers.get(CCR1 + 4 * channel, 0)
        if mode & 3 or mode >> 4 & 7 != PWM_MODE_1 or width > registers[ARR]:
            return 0  # an input, no PWM, or a level that is always high
        hz = self._clock_hz()
        return (width * (registers.get(PSC, 0) + 1) * US_PER_S + hz // 2) // hz

    def write(self, offset: int, value: int) -> None:
        """Write a register."""
        self.registers[offset] = value
        if CCR1 <= offset <= CCR4:
            self.width_set_ns = now_ns()
