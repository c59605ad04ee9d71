"""System registers of the core at 0xE000E000: SysTick, interrupt controller, system control block (ARMv7-M, B3)."""

from collections.abc import Callable
from typing import ClassVar

from firmware_stub.emulation.nvic import FIRST_INTERRUPT, NMI, PENDSV, SYSTICK, Nvic
from firmware_stub.emulation.peripheral import WORD, Peripheral, Ticks, Time
from hil.common.clock import NEVER_NS

SYST_CSR, SYST_RVR, SYST_CVR, SYST_CALIB = 0x10, 0x14, 0x18, 0x1C
SYST_ENABLE, SYST_TICKINT, SYST_CLKSOURCE, SYST_COUNTFLAG = 1, 2, 4, 1 << 16
ISER, ICER, ISPR, ICPR, IABR, IPR, IPR_END = 0x100, 0x180, 0x200, 0x280, 0x300, 0x400, 0x4F0
CPUID, ICSR, VTOR, AIRCR, SCR, SHPR1, SHPR3, STIR = 0xD00, 0xD04, 0xD08, 0xD0C, 0xD10, 0xD18, 0xD20, 0xF00
AIRCR_KEY, SYSRESETREQ = 0x05FA, 1 << 2
SLEEPONEXIT = 1 << 1


class SystemControl(Peripheral):
    """The registers of the interrupt controller and of the system control block, and the SysTick timer.

    core_hz: returns the core's frequency. request_reset: called when the program requests a reset. SysTick's counter is
    reloaded at the time of its interrupt, one clock cycle too early.
    Not modelled: memory protection unit, fault status (faults end the emulation), debug registers.
    """

    RESET: ClassVar[dict[int, int]] = {CPUID: 0x410F_C241, 0xD14: 0x200, SYST_CALIB: 0x4000_0000}

    def __init__(self, time: Time, nvic: Nvic, core_hz: Callable[[], int], request_reset: Callable[[], None]) -> None:
        super().__init__()
        self._time = time
        self._nvic = nvic
        self._core_hz = core_hz
        self._request_reset = request_reset
        self.reset()

    def reset(self) -> None:
        """Reset the registers, and stop SysTick."""
        super().reset()
        self._restart(0)

    @property
    def vector_table(self) -> int:
        """Address of the vector table."""
        return self.registers.get(VTOR, 0)

    @property
    def sleep_on_exit(self) -> bool:
        """True if the core goes to sleep after its last pending exception (SLEEPONEXIT of the SCR)."""
        return bool(self.registers.get(SCR, 0) & SLEEPONEXIT)

    def read(self, offset: int) -> int:
        """Return a register of the core."""
        if offset == SYST_CVR:
            return self._count_down()
        if offset == SYST_CSR:
            return self._read_csr()
        word = (offset & 0x7F) // 4
        if offset < ISER or offset >= IPR:
            return self._read_icsr() if offset == ICSR else self.registers.get(offset, 0)
        if offset >= IABR:
            return self._nvic.active_word(word)
        bits = self._nvic.enabled if offset < ISPR else self._nvic.pending
        return bits >> FIRST_INTERRUPT + 32 * word & WORD

    def write(self, offset: int, value: int) -> None:
        """Write a register of the core."""
        if offset <= SYST_CALIB:
            self._write_systick(offset, value)
        elif ISER <= offset < IABR:
            self._write_bits(offset, value << FIRST_INTERRUPT + 32 * ((offset & 0x7F) // 4))
        elif IPR <= offset < IPR_END:
            self._write_priorities(offset, value, FIRST_INTERRUPT + offset - IPR)
        elif SHPR1 <= offset <= SHPR3:
            self._write_priorities(offset, value, 4 + offset - SHPR1)
        else:
            self._write_control(offset, value)

    def tick(self) -> None:
        """Handle SysTick's counter at zero: request its interrupt."""
        self._nvic.pend(1 << SYSTICK)
        self._schedule(self._wraps() + 1)

    def retime(self) -> None:
        """Continue at the new frequency from the present value of the counter."""
        self._restart(self._wrap_length() - 1 - self._count_down())

    def _write_systick(self, offset: int, value: int) -> None:
        count = self._count()
        if offset == SYST_CSR:
            was_on = self.registers.get(SYST_CSR, 0) & SYST_ENABLE
            self.registers[SYST_CSR] = value & 7
            self._restart(count if was_on else 0)
        elif offset == SYST_RVR:
            self.registers[SYST_RVR] = value & 0xFF_FFFF
            self._restart(min(count, self._wrap_length() - 1))
        elif offset == SYST_CVR:
            self._restart(0)

    def _restart(self, count: int) -> None:
        source = self.registers.get(SYST_CSR, 0)
        hz = self._core_hz() if source & SYST_CLKSOURCE else self._core_hz() // 8
        self._ticks = Ticks(self._time, hz)
        self._offset = count
        self._wraps_seen = 0
        self._schedule(1)

    def _schedule(self, wrap: int) -> None:
        runs = self.registers.get(SYST_CSR, 0) & (SYST_ENABLE | SYST_TICKINT) == SYST_ENABLE | SYST_TICKINT
        length = self._wrap_length()
        self.due_ns = self._ticks.instant_ns(wrap * length - self._offset) if runs and length > 1 else NEVER_NS

    def _wrap_length(self) -> int:
        return self.registers.get(SYST_RVR, 0) + 1

    def _count(self) -> int:
        """Return the clock ticks since the counter was last at its reload value."""
        if not self.registers.get(SYST_CSR, 0) & SYST_ENABLE:
            return 0
        return (self._offset + self._ticks.count()) % self._wrap_length()

    def _wraps(self) -> int:
        if not self.registers.get(SYST_CSR, 0) & SYST_ENABLE:
            return 0
        return (self._offset + self._ticks.count()) // self._wrap_length()

    def _count_down(self) -> int:
        return self._wrap_length() - 1 - self._count()

    def _read_csr(self) -> int:
        wraps = self._wraps()
        counted = wraps > self._wraps_seen
        self._wraps_seen = wraps
        return self.registers.get(SYST_CSR, 0) | (SYST_COUNTFLAG if counted else 0)

    def _write_bits(self, offset: int, bits: int) -> None:
        if offset < ISPR:
            self._nvic.enable(bits, offset < ICER)
        elif offset < ICPR:
            self._nvic.pend(bits)
        else:
            self._nvic.unpend(bits)

    def _write_priorities(self, offset: int, value: int, first: int) -> None:
        self.registers[offset] = value & 0xF0F0_F0F0
        for i in range(4):
            self._nvic.set_priority(first + i, value >> 8 * i & 0xFF)

    def _read_icsr(self) -> int:
        nvic = self._nvic
        active = nvic.active[-1] if nvic.active else 0
        pending = nvic.pending
        return (
            active
            | nvic.next << 12
            | bool(pending >> FIRST_INTERRUPT) << 22
            | (pending >> SYSTICK & 1) << 26
            | (pending >> PENDSV & 1) << 28
        )

    def _write_icsr(self, value: int) -> None:
        for bit, number in ((31, NMI), (28, PENDSV), (26, SYSTICK)):
            if value >> bit & 1:
                self._nvic.pend(1 << number)
        for bit, number in ((27, PENDSV), (25, SYSTICK)):
            if value >> bit & 1:
                self._nvic.unpend(1 << number)

    def _write_control(self, offset: int, value: int) -> None:
        if offset == ICSR:
            self._write_icsr(value)
        elif offset == STIR:
            self._nvic.pend(1 << FIRST_INTERRUPT + (value & 0x1FF))
        elif offset == AIRCR:
            if value >> 16 == AIRCR_KEY:
                self.registers[AIRCR] = 0xFA05_0000 | value & 0x700
                if value & SYSRESETREQ:
                    self._request_reset()
        elif offset == VTOR:
            self.registers[VTOR] = value & 0xFFFF_FE00
        elif offset != CPUID:
            self.registers[offset] = value
