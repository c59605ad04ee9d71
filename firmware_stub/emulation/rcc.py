"""Reset and clock control (F4: RM0090, section 7; F1: RM0008, section 7): frequencies, and enable bits."""

from typing import ClassVar

from firmware_stub.emulation.peripheral import Peripheral

CR, PLLCFGR, CFGR = 0x00, 0x04, 0x08
AHB1ENR, F1_AHBENR, F1_CFGR = 0x30, 0x14, 0x04
HSI_HZ, HSE_HZ = 16_000_000, 8_000_000


class Rcc(Peripheral):
    """Clocks of an F4. An oscillator is ready as soon as it is enabled; the crystal has 8 MHz.

    Not modelled: resets of single peripherals, the flags of the last reset's cause.
    """

    cfgr, hsi_hz = CFGR, HSI_HZ
    ppre1_place, ppre2_place = 10, 13  # in CFGR
    RESET: ClassVar[dict[int, int]] = {CR: 0x83, PLLCFGR: 0x2400_3010, AHB1ENR: 0x10_0000}

    def __init__(self) -> None:
        super().__init__()
        self._compute_clocks()

    def reset(self) -> None:
        """Reset all registers."""
        super().reset()
        self._compute_clocks()

    def write(self, offset: int, value: int) -> None:
        """Write a register. Oscillators are ready, and clock changes take effect, at once."""
        if offset == CR:
            value = value & 0x050D_00F9 | (value >> 24 & 5) << 25 | (value >> 16 & 1) << 17 | (value & 1) << 1
        elif offset == self.cfgr:
            value = value & ~0xC | (value & 3) << 2
        self.registers[offset] = value
        self._compute_clocks()

    def _compute_clocks(self) -> None:
        """Compute the clocks' frequencies, in Hz."""
        cfgr = self.registers.get(self.cfgr, 0)
        hpre, ppre1, ppre2 = cfgr >> 4 & 15, cfgr >> self.ppre1_place & 7, cfgr >> self.ppre2_place & 7
        source = (self.hsi_hz, HSE_HZ, self._pll_hz(), self.hsi_hz)[cfgr & 3]
        shift = 0 if hpre < 8 else hpre - 7 if hpre < 12 else hpre - 6  # 2, 4, 8, 16, then 64 to 512
        self.core_hz = source >> shift
        self.apb1_hz = self.core_hz >> max(0, ppre1 - 3)
        self.apb2_hz = self.core_hz >> max(0, ppre2 - 3)
        self.apb1_timer_hz = self.apb1_hz * (1 if ppre1 < 4 else 2)

    def _pll_hz(self) -> int:
        pll = self.registers.get(PLLCFGR, 0)
        source = HSE_HZ if pll >> 22 & 1 else HSI_HZ
        divider = max(pll & 63, 1)
        return source * (pll >> 6 & 511) // divider // (2 * (pll >> 16 & 3) + 2)


class RccF1(Rcc):
    """Clocks of an F1 (RM0008, section 7.3)."""

    cfgr, hsi_hz = F1_CFGR, 8_000_000
    ppre1_place, ppre2_place = 8, 11
    RESET: ClassVar[dict[int, int]] = {CR: 0x83, F1_AHBENR: 0x14}

    def _pll_hz(self) -> int:
        cfgr = self.registers.get(F1_CFGR, 0)
        source = HSE_HZ >> (cfgr >> 17 & 1) if cfgr >> 16 & 1 else self.hsi_hz // 2
        return source * min((cfgr >> 18 & 15) + 2, 16)
