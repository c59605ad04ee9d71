"""Timers 1 to 8 (RM0090, sections 17, 18 and 20): counting up, update interrupt, PWM pulses."""

from collections.abc import Callable
from typing import ClassVar

from firmware_stub.emulation.peripheral import Peripheral, Ticks, Time
from hil.common.clock import NEVER_NS, now_ns

CR1, DIER, SR, EGR, CCMR1, CCER = 0x00, 0x0C, 0x10, 0x14, 0x18, 0x20
CNT, PSC, ARR, CCR1, CCR4, BDTR = 0x24, 0x28, 0x2C, 0x34, 0x40, 0x44
CEN, UIE, UIF, UG, MOE = 1, 1, 1, 1, 1 << 15
PWM_MODE_1, PWM_MODE_2 = 6, 7
US_PER_S = 1_000_000


class Timer(Peripheral):
    """A timer with up to four outputs.

    clock_hz: returns its input frequency. interrupt: called with the state of its interrupt request. gated: whether its
    outputs need the main output enable of the advanced timers (BDTR.MOE). bits: width of the counter.
    Not modelled: counting down, one-pulse mode, slave modes, capture, compare interrupts, DMA. New settings take effect
    at once, not in the next period.
    """

    RESET: ClassVar[dict[int, int]] = {ARR: 0xFFFF}

    def __init__(
        self, time: Time, clock_hz: Callable[[], int], interrupt: Callable[[bool], None], gated: bool, bits: int
    ) -> None:
        super().__init__()
        self._time = time
        self._clock_hz = clock_hz
        self._interrupt = interrupt
        self._gated = gated
        self._mask = (1 << bits) - 1
        self.width_set_ns = 0  # monotonic time, not simulated, of the program's last write of a pulse width
        self.reset()

    def reset(self) -> None:
        """Stop the timer, and reset its registers."""
        super().reset()
        self.registers[ARR] = self._mask
        self._restart(0)
        self._interrupt(False)

    def pulse_us(self, channel: int) -> int:
        """Return the rounded width (us) of the pulses on an output, 0 to 3; 0 without pulses."""
        registers = self.registers
        if not registers.get(CR1, 0) & CEN or (self._gated and not registers.get(BDTR, 0) & MOE):
            return 0
        if not registers.get(CCER, 0) >> 4 * channel & 1:
            return 0
        mode = registers.get(CCMR1 + 4 * (channel // 2), 0) >> 8 * (channel % 2)
        width, period = registers.get(CCR1 + 4 * channel, 0), registers[ARR] + 1
        if mode & 3 or width >= period or mode >> 4 & 7 not in (PWM_MODE_1, PWM_MODE_2):
            return 0  # an input, a level that is always high, or no PWM
        if mode >> 4 & 7 == PWM_MODE_2:
            width = period - width
        hz = self._clock_hz()
        return (width * (registers.get(PSC, 0) + 1) * US_PER_S + hz // 2) // hz

    def read(self, offset: int) -> int:
        """Return a register, with the present counter and update flag."""
        if offset == CNT:
            return self._count() % (self.registers[ARR] + 1)
        if offset == SR:
            self._set_update_flag()
        return self.registers.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        """Write a register. If it changes how the timer counts, counting continues from the present value."""
        if offset == SR:
            self._set_update_flag()
            self.registers[SR] = self.registers.get(SR, 0) & value
        elif offset == EGR:
            self._generate(value)
        elif offset in (CR1, PSC, ARR, CNT):
            count = self._count() % (self.registers[ARR] + 1)
            self._set_update_flag()
            self.registers[offset] = value & self._mask
            self._restart(value if offset == CNT else count)
        else:
            self.registers[offset] = value
            if CCR1 <= offset <= CCR4:
                self.width_set_ns = now_ns()
                return  # counting does not change
        self._schedule()

    def tick(self) -> None:
        """Handle the overflow of the counter."""
        self._set_update_flag()
        self._schedule()

    def retime(self) -> None:
        """Continue at the new frequency from the present count."""
        count = self._count() % (self.registers[ARR] + 1)
        self._set_update_flag()
        self._restart(count)
        self._schedule()

    def _generate(self, value: int) -> None:
        if value & UG:
            self._restart(0)
            if not self.registers.get(CR1, 0) & 4:  # URS: only overflows count
                self.registers[SR] = self.registers.get(SR, 0) | UIF

    def _restart(self, count: int) -> None:
        self._first = count & self._mask
        self._updates_seen = 0
        self._ticks = Ticks(self._time, self._clock_hz())

    def _count(self) -> int:
        """Return the count since the last restart, without wrapping at the period."""
        if not self.registers.get(CR1, 0) & CEN:
            return self._first
        return self._first + self._ticks.count() // (self.registers.get(PSC, 0) + 1)

    def _set_update_flag(self) -> None:
        updates = self._count() // (self.registers[ARR] + 1)
        if updates > self._updates_seen:
            self._updates_seen = updates
            self.registers[SR] = self.registers.get(SR, 0) | UIF

    def _schedule(self) -> None:
        """Set the interrupt line, and the time of the next event."""
        registers = self.registers
        is_enabled = bool(registers.get(DIER, 0) & UIE)
        self._interrupt(is_enabled and bool(registers.get(SR, 0) & UIF))
        if is_enabled and registers.get(CR1, 0) & CEN and registers[ARR]:
            steps = (self._updates_seen + 1) * (registers[ARR] + 1) - self._first
            self.due_ns = self._ticks.instant_ns(steps * (registers.get(PSC, 0) + 1))
        else:
            self.due_ns = NEVER_NS
