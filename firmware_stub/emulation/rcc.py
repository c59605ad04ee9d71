"""Reset and clock control (F4: RM0090, section 7; F1: RM0008, section 7): frequencies, enables, reset causes."""

from collections.abc import Callable
from typing import ClassVar

from firmware_stub.emulation.models import F1_APB1ENR, F1_APB2ENR
from firmware_stub.emulation.peripheral import Peripheral

CR, PLLCFGR, CFGR, BDCR, CSR = 0x00, 0x04, 0x08, 0x70, 0x74
AHB1RSTR, APB2RSTR, AHB1ENR = 0x10, 0x24, 0x30
F1_CFGR, F1_APB2RSTR, F1_APB1RSTR, F1_AHBENR, F1_BDCR, F1_CSR = 0x04, 0x0C, 0x10, 0x14, 0x20, 0x24
HSI_HZ, HSE_HZ = 16_000_000, 8_000_000
PIN_RESET, POWER_RESET, SOFTWARE_RESET, WATCHDOG_RESET = 1 << 26, 1 << 27, 1 << 28, 1 << 29  # flags of CSR
REMOVE_FLAGS = 1 << 24


class Rcc(Peripheral):
    """Clocks of an F4. An oscillator is ready as soon as it is enabled; the crystal has 8 MHz.

    on_change: called after a write that may change a frequency. reset_blocks: called with the offset of a register of
    enable bits, and the bits of the peripherals to reset.
    """

    cfgr, bdcr, csr, hsi_hz = CFGR, BDCR, CSR, HSI_HZ
    enabled_by: ClassVar[dict[int, int]] = {
        reset: reset + AHB1ENR - AHB1RSTR for reset in range(AHB1RSTR, APB2RSTR + 4, 4)
    }
    ppre1_place, ppre2_place = 10, 13  # in CFGR
    RESET: ClassVar[dict[int, int]] = {CR: 0x83, PLLCFGR: 0x2400_3010, AHB1ENR: 0x10_0000, CSR: POWER_RESET | PIN_RESET}

    def __init__(self, on_change: Callable[[], None], reset_blocks: Callable[[int, int], None]) -> None:
        super().__init__()
        self._on_change = on_change
        self._reset_blocks = reset_blocks
        self._compute_clocks()

    def reset_by(self, causes: int) -> None:
        """Reset all registers, but not the flags in CSR; add `causes` to these flags."""
        flags = self.registers.get(self.csr, 0) & 0xFE00_0000
        super().reset()
        self.registers[self.csr] = flags | causes | PIN_RESET  # every reset drives the reset pin low: RM0090 6.1.1
        self._compute_clocks()

    def write(self, offset: int, value: int) -> None:
        """Write a register. Oscillators are ready, and clock changes take effect, at once."""
        if offset == CR:
            value = value & 0x050D_00F9 | (value >> 24 & 5) << 25 | (value >> 16 & 1) << 17 | (value & 1) << 1
        elif offset == self.cfgr:
            value = value & ~0xC | (value & 3) << 2
        elif offset == self.bdcr:
            value = value & ~2 | (value & 1) << 1
        elif offset == self.csr:
            flags = 0 if value & REMOVE_FLAGS else self.registers[self.csr] & 0xFE00_0000
            value = flags | value & 1 | (value & 1) << 1
        self.registers[offset] = value
        if value and offset in self.enabled_by:
            self._reset_blocks(self.enabled_by[offset], value)
        if offset in (CR, PLLCFGR, self.cfgr):
            self._compute_clocks()
            self._on_change()

    def _compute_clocks(self) -> None:
        """Compute the clocks' frequencies, in Hz."""
        cfgr = self.registers.get(self.cfgr, 0)
        hpre, ppre1, ppre2 = cfgr >> 4 & 15, cfgr >> self.ppre1_place & 7, cfgr >> self.ppre2_place & 7
        source = (self.hsi_hz, HSE_HZ, self._pll_hz(), self.hsi_hz)[cfgr & 3]
        shift = 0 if hpre < 8 else hpre - 7 if hpre < 12 else hpre - 6  # 2, 4, 8, 16, then 64 to 512
        self.core_hz = source >> shift
        self.apb1_hz, self.apb1_timer_hz = self._bus_hz(ppre1)
        self.apb2_hz, self.apb2_timer_hz = self._bus_hz(ppre2)

    def _bus_hz(self, prescaler: int) -> tuple[int, int]:
        """Return the frequencies (Hz) of a bus and of its timers. With a prescaler the timers have twice that of the
        bus."""
        if prescaler < 4:
            return self.core_hz, self.core_hz
        hz = self.core_hz >> prescaler - 3
        return hz, 2 * hz

    def _pll_hz(self) -> int:
        pll = self.registers.get(PLLCFGR, 0)
        source = HSE_HZ if pll >> 22 & 1 else HSI_HZ
        divider = max(pll & 63, 1)
        return source * (pll >> 6 & 511) // divider // (2 * (pll >> 16 & 3) + 2)


class RccF1(Rcc):
    """Clocks of an F1 (RM0008, section 7.3)."""

    cfgr, bdcr, csr, hsi_hz = F1_CFGR, F1_BDCR, F1_CSR, 8_000_000
    enabled_by: ClassVar[dict[int, int]] = {F1_APB2RSTR: F1_APB2ENR, F1_APB1RSTR: F1_APB1ENR}
    ppre1_place, ppre2_place = 8, 11
    RESET: ClassVar[dict[int, int]] = {CR: 0x83, F1_AHBENR: 0x14, F1_CSR: POWER_RESET | PIN_RESET}

    def _pll_hz(self) -> int:
        cfgr = self.registers.get(F1_CFGR, 0)
        source = HSE_HZ >> (cfgr >> 17 & 1) if cfgr >> 16 & 1 else self.hsi_hz // 2
        return source * min((cfgr >> 18 & 15) + 2, 16)
