"""System registers of the core at 0xE000E000: SysTick, and the enable bits of interrupts (ARMv7-M, B3)."""

from collections.abc import Callable

from firmware_stub.emulation.nvic import FIRST_INTERRUPT, SYSTICK, Nvic
from firmware_stub.emulation.peripheral import Peripheral, Ticks, Time
from hil.common.clock import NEVER_NS
from hil.common.errors import DeviceError

SYST_CSR, SYST_RVR, SYST_CVR = 0x10, 0x14, 0x18
ISER, ISER_END, ICSR = 0x100, 0x120, 0xD04
PENDSTSET = 1 << 26
ON = 7  # of SYST_CSR: the core's clock, interrupt, enabled


class SystemControl(Peripheral):
    """The registers of SysTick, and those that enable interrupts and request SysTick's exception.

    core_hz: returns the core's frequency. A write to SysTick starts its counter again, at the present frequency. It is
    reloaded at the time of its interrupt, one clock cycle too early.
    Not modelled: all other registers of the core; an access to one of them is a fault.
    """

    def __init__(self, time: Time, nvic: Nvic, core_hz: Callable[[], int]) -> None:
        super().__init__()
        self._time = time
        self._nvic = nvic
        self._core_hz = core_hz
        self.reset()

    def reset(self) -> None:
        """Reset the registers, and stop SysTick."""
        super().reset()
        self._restart()

    def read(self, offset: int) -> int:
        """Return a register of SysTick. Raises DeviceError for any other."""
        if offset == SYST_CVR:
            return self._length() - 1 - (self._ticks.count() % self._length() if self._is_on() else 0)
        if offset not in (SYST_CSR, SYST_RVR):
            raise _not_modelled_error(offset)
        return self.registers.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        """Write a register of SysTick, or enable interrupts. Raises DeviceError for any other register."""
        if offset in (SYST_CSR, SYST_RVR, SYST_CVR):
            self.registers[offset] = value & 0xFF_FFFF
            self._restart()
        elif ISER <= offset < ISER_END:
            self._nvic.enable(value << FIRST_INTERRUPT + 8 * (offset - ISER))
        elif offset == ICSR and value == PENDSTSET:
            self._nvic.pend(SYSTICK)
        else:
            raise _not_modelled_error(offset)

    def tick(self) -> None:
        """Handle SysTick's counter at zero: request its interrupt."""
        self._nvic.pend(SYSTICK)
        self._schedule()

    def _restart(self) -> None:
        self._ticks = Ticks(self._time, self._core_hz())
        self._schedule()

    def _schedule(self) -> None:
        length = self._length()
        wraps = self._ticks.count() // length + 1
        self.due_ns = self._ticks.instant_ns(wraps * length) if self._is_on() and length > 1 else NEVER_NS

    def _length(self) -> int:
        return self.registers.get(SYST_RVR, 0) + 1

    def _is_on(self) -> bool:
        return self.registers.get(SYST_CSR, 0) & ON == ON


def _not_modelled_error(offset: int) -> DeviceError:
    return DeviceError(f"the register at 0x{0xE000_E000 + offset:08x} is not modelled")
