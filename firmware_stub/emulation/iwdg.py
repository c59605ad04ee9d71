"""Independent watchdog (RM0090, section 21)."""

from collections.abc import Callable
from typing import ClassVar

from firmware_stub.emulation.peripheral import Peripheral, Ticks, Time
from hil.common.clock import NEVER_NS

KR, PR, RLR = 0x00, 0x04, 0x08
UNLOCK, RELOAD, START = 0x5555, 0xAAAA, 0xCCCC
LSI_HZ = 32_000


class Iwdg(Peripheral):
    """Watchdog that calls `on_expiry` unless its counter is reloaded in time. Only a reset stops it.

    Its oscillator has the nominal 32 kHz; real chips have 17 to 47 kHz.
    """

    RESET: ClassVar[dict[int, int]] = {RLR: 0xFFF}

    def __init__(self, time: Time, on_expiry: Callable[[], None]) -> None:
        super().__init__()
        self._time = time
        self._on_expiry = on_expiry
        self.reset()

    def reset(self) -> None:
        """Stop the watchdog, and reset its registers."""
        super().reset()
        self._runs = False
        self._unlocked = False

    def read(self, offset: int) -> int:
        """Return a register. Key and status read as 0; the status because updates take no time."""
        return self.registers.get(offset, 0) if offset in (PR, RLR) else 0

    def write(self, offset: int, value: int) -> None:
        """Write a key, or a setting if unlocked. Settings take effect at the next reload."""
        if offset == KR:
            self._write_key(value & 0xFFFF)
        elif self._unlocked:
            self.registers[offset] = value & (7 if offset == PR else 0xFFF)

    def tick(self) -> None:
        """Handle the expiry of the counter."""
        self.due_ns = NEVER_NS
        self._on_expiry()

    def _write_key(self, key: int) -> None:
        self._unlocked = key == UNLOCK
        if key == START:
            self._runs = True
        if self._runs and key in (START, RELOAD):
            prescaler = 4 << min(self.registers.get(PR, 0), 6)
            self.due_ns = Ticks(self._time, LSI_HZ).instant_ns((self.registers[RLR] + 1) * prescaler)
