"""Reset and clock control (RM0090, section 7): clock frequencies, clock enables, causes of reset."""

from collections.abc import Callable
from typing import ClassVar

from firmware_stub.emulation.peripheral import Peripheral

CR, PLLCFGR, CFGR, BDCR, CSR = 0x00, 0x04, 0x08, 0x70, 0x74
AHB1RSTR, APB2RSTR = 0x10, 0x24
AHB1ENR, APB1ENR, APB2ENR = 0x30, 0x40, 0x44
TO_ENABLE = AHB1ENR - AHB1RSTR  # from a bus's reset register to its enable register
HSI_HZ, HSE_HZ = 16_000_000, 8_000_000
PIN_RESET, POWER_RESET, SOFTWARE_RESET, WATCHDOG_RESET = 1 << 26, 1 << 27, 1 << 28, 1 << 29  # flags of CSR
REMOVE_FLAGS = 1 << 24


class Rcc(Peripheral):
    """An oscillator that is switched on is ready at once; the crystal has 8 MHz.

    on_change is called after a write that may change a frequency; reset_blocks with the register of enable bits
    and those of its bits whose peripherals are reset.
    """

    RESET: ClassVar[dict[int, int]] = {CR: 0x83, PLLCFGR: 0x2400_3010, AHB1ENR: 0x10_0000, CSR: POWER_RESET | PIN_RESET}

    def __init__(self, on_change: Callable[[], None], reset_blocks: Callable[[int, int], None]) -> None:
        super().__init__()
        self._on_change = on_change
        self._reset_blocks = reset_blocks
        self._measure()

    def reset_by(self, causes: int) -> None:
        """Reset; add `causes` to the flags of CSR, which survive it."""
        flags = self.words.get(CSR, 0) & 0xFE00_0000
        super().reset()
        self.words[CSR] = flags | causes | PIN_RESET  # every reset pulls the pin: RM0090 6.1.1
        self._measure()

    def write(self, offset: int, value: int) -> None:
        """Oscillators follow their switches; a change of clock takes effect at once."""
        if offset == CR:
            value = value & 0x050D_00F9 | (value >> 24 & 5) << 25 | (value >> 16 & 1) << 17 | (value & 1) << 1
        elif offset == CFGR:
            value = value & ~0xC | (value & 3) << 2
        elif offset == BDCR:
            value = value & ~2 | (value & 1) << 1
        elif offset == CSR:
            flags = 0 if value & REMOVE_FLAGS else self.words[CSR] & 0xFE00_0000
            value = flags | value & 1 | (value & 1) << 1
        self.words[offset] = value
        if AHB1RSTR <= offset <= APB2RSTR and value:
            self._reset_blocks(offset + TO_ENABLE, value)
        if offset in (CR, PLLCFGR, CFGR):
            self._measure()
            self._on_change()

    def _measure(self) -> None:
        """Compute the clocks' frequencies, in Hz."""
        cfgr = self.words.get(CFGR, 0)
        hpre, ppre1, ppre2 = cfgr >> 4 & 15, cfgr >> 10 & 7, cfgr >> 13 & 7
        source = (HSI_HZ, HSE_HZ, self._pll_hz(), HSI_HZ)[cfgr & 3]
        shift = 0 if hpre < 8 else hpre - 7 if hpre < 12 else hpre - 6  # 2, 4, 8, 16, then 64 to 512
        self.core_hz = source >> shift
        self.apb1_hz, self.apb1_timer_hz = self._bus_hz(ppre1)
        self.apb2_hz, self.apb2_timer_hz = self._bus_hz(ppre2)

    def _bus_hz(self, prescaler: int) -> tuple[int, int]:
        """Return the clock of a bus, and of its timers, which run at twice that unless it is undivided."""
        if prescaler < 4:
            return self.core_hz, self.core_hz
        hz = self.core_hz >> prescaler - 3
        return hz, 2 * hz

    def _pll_hz(self) -> int:
        pll = self.words.get(PLLCFGR, 0)
        source = HSE_HZ if pll >> 22 & 1 else HSI_HZ
        divider = max(pll & 63, 1)
        return source * (pll >> 6 & 511) // divider // (2 * (pll >> 16 & 3) + 2)
