"""A program on the emulated STM32F405, written register by register."""

import pytest

from firmware_stub.emulation.chip import Chip
from firmware_stub.emulation.models import F405_PLACES
from firmware_stub.emulation.nvic import FIRST_INTERRUPT

MS = 1_000_000


RCC, USART1, TIM3, IWDG, CAN1, GPIOA = (
    F405_PLACES[name].address for name in ("RCC", "USART1", "TIM3", "IWDG", "CAN1", "GPIOA")
)


USART1_IRQ, CAN1_TX_IRQ, CAN1_RX0_IRQ = 37, 19, 20


class Program:
    """A chip with all peripherals enabled, and the register accesses of a program."""

    def __init__(self, paced: bool = False) -> None:
        self.chip = Chip(paced)
        for register in (0x30, 0x40, 0x44):
            self.put(RCC + register, 0xFFFF_FFFF)

    def put(self, address: int, value: int, size: int = 4) -> None:
        self.chip.write(address, size, value)

    def get(self, address: int, size: int = 4) -> int:
        return self.chip.read(address, size)

    def wait_until(self, end_ns: int) -> None:
        chip = self.chip
        while chip.due_ns <= end_ns:
            chip.time.now_ns = chip.due_ns
            chip.tick()
        chip.time.now_ns = end_ns

    def is_pending(self, interrupt: int) -> bool:
        return bool(self.chip.nvic.pending >> FIRST_INTERRUPT + interrupt & 1)

    def full_speed(self) -> None:
        """Set 168 MHz from the crystal: APB1 42 MHz, APB2 84 MHz."""
        self.put(RCC, 0x0101_0083)
        self.put(RCC + 4, 7 << 24 | 1 << 22 | 336 << 6 | 8)
        self.put(RCC + 8, 4 << 13 | 5 << 10 | 2)


@pytest.fixture
def program() -> Program:
    return Program()
