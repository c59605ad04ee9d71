"""The STM32F405 around its core: memory map, clock enables, and resets.

Addresses and interrupt numbers: RM0090, tables 1 and 62; enable bits: sections 7.3.10 to 7.3.14.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from firmware_stub.emulation.bxcan import BxCan
from firmware_stub.emulation.iwdg import Iwdg
from firmware_stub.emulation.nvic import FIRST_INTERRUPT, Nvic
from firmware_stub.emulation.peripheral import Peripheral, Time
from firmware_stub.emulation.rcc import (
    AHB1ENR,
    APB1ENR,
    APB2ENR,
    SOFTWARE_RESET,
    WATCHDOG_RESET,
    Rcc,
)
from firmware_stub.emulation.system import SystemControl
from firmware_stub.emulation.timer import Timer
from firmware_stub.emulation.usart import Usart
from hil.common.errors import DeviceError

PERIPHERALS, PERIPHERALS_SIZE = 0x4000_0000, 0x8_0000
CORE_REGISTERS, CORE_REGISTERS_SIZE = 0xE000_0000, 0x10_0000
SYSTEM_CONTROL = 0xE000_E000
BLOCK = 0x400


class Place(NamedTuple):
    """Address of a peripheral, and the bit that switches its clock on (register 0: always on)."""

    address: int
    register: int = 0
    bit: int = 0


PLACES = {
    **{f"TIM{2 + i}": Place(0x4000_0000 + BLOCK * i, APB1ENR, i) for i in range(6)},
    **{f"TIM{12 + i}": Place(0x4000_1800 + BLOCK * i, APB1ENR, 6 + i) for i in range(3)},
    "RTC": Place(0x4000_2800), "WWDG": Place(0x4000_2C00, APB1ENR, 11), "IWDG": Place(0x4000_3000),
    "I2S2EXT": Place(0x4000_3400, APB1ENR, 14), "SPI2": Place(0x4000_3800, APB1ENR, 14),
    "SPI3": Place(0x4000_3C00, APB1ENR, 15), "I2S3EXT": Place(0x4000_4000, APB1ENR, 15),
    "USART2": Place(0x4000_4400, APB1ENR, 17), "USART3": Place(0x4000_4800, APB1ENR, 18),
    "UART4": Place(0x4000_4C00, APB1ENR, 19), "UART5": Place(0x4000_5000, APB1ENR, 20),
    "I2C1": Place(0x4000_5400, APB1ENR, 21), "I2C2": Place(0x4000_5800, APB1ENR, 22),
    "I2C3": Place(0x4000_5C00, APB1ENR, 23),
    "CAN1": Place(0x4000_6400, APB1ENR, 25), "CAN2": Place(0x4000_6800, APB1ENR, 26),
    "PWR": Place(0x4000_7000, APB1ENR, 28), "DAC": Place(0x4000_7400, APB1ENR, 29),
    "TIM1": Place(0x4001_0000, APB2ENR, 0), "TIM8": Place(0x4001_0400, APB2ENR, 1),
    "USART1": Place(0x4001_1000, APB2ENR, 4), "USART6": Place(0x4001_1400, APB2ENR, 5),
    "ADC": Place(0x4001_2000), "SDIO": Place(0x4001_2C00, APB2ENR, 11), "SPI1": Place(0x4001_3000, APB2ENR, 12),
    "SYSCFG": Place(0x4001_3800, APB2ENR, 14), "EXTI": Place(0x4001_3C00),
    **{f"TIM{9 + i}": Place(0x4001_4000 + BLOCK * i, APB2ENR, 16 + i) for i in range(3)},
    **{f"GPIO{'ABCDEFGHI'[i]}": Place(0x4002_0000 + BLOCK * i, AHB1ENR, i) for i in range(9)},
    "CRC": Place(0x4002_3000, AHB1ENR, 12), "RCC": Place(0x4002_3800), "FLASH": Place(0x4002_3C00),
    "BKPSRAM": Place(0x4002_4000, AHB1ENR, 18),
    "DMA1": Place(0x4002_6000, AHB1ENR, 21), "DMA2": Place(0x4002_6400, AHB1ENR, 22),
}  # fmt: skip
USART_INTERRUPTS = {"USART1": 37, "USART2": 38, "USART3": 39, "UART4": 52, "UART5": 53, "USART6": 71}
TIMER_INTERRUPTS = {"TIM1": 25, "TIM2": 28, "TIM3": 29, "TIM4": 30, "TIM5": 50, "TIM6": 54, "TIM7": 55, "TIM8": 44}
ADVANCED_TIMERS, WIDE_TIMERS = ("TIM1", "TIM8"), ("TIM2", "TIM5")
CAN1_INTERRUPTS = (19, 20, 21)  # transmit, FIFO 0, FIFO 1


class Chip:
    """The peripherals by name, their registers by address, and when the next of them has to act.

    `reset_by` is not 0 once the program or the watchdog has requested a reset: it is the flag of the cause.
    paced: whether bytes take their time on the serial lines.
    """

    def __init__(self, paced: bool) -> None:
        self.time = Time()
        self.nvic = Nvic()
        self.reset_by = 0
        self.rcc = Rcc(self._retime, self._reset_blocks)
        self.system = SystemControl(self.time, self.nvic, lambda: self.rcc.core_hz, self._program_resets)
        self.iwdg = Iwdg(self.time, self._watchdog_resets)
        self.can = BxCan(*(self._line(number) for number in CAN1_INTERRUPTS))
        self.usarts = {name: self._make_usart(name, paced) for name in USART_INTERRUPTS}
        self.timers = {name: self._make_timer(name) for name in TIMER_INTERRUPTS}
        self.peripherals: dict[str, Peripheral] = {name: Peripheral() for name in PLACES}
        self.peripherals |= self.usarts | self.timers | {"RCC": self.rcc, "IWDG": self.iwdg, "CAN1": self.can}
        self._timed = [self.system, self.iwdg, *self.usarts.values(), *self.timers.values()]
        self._blocks = self._lay_out()

    @property
    def due_ns(self) -> int:
        """Time of the next event of a peripheral (ns): `tick` has to be called then."""
        return min([peripheral.due_ns for peripheral in self._timed])

    def tick(self) -> None:
        """Run the peripherals that are due now."""
        now = self.time.now_ns
        for peripheral in self._timed:
            if peripheral.due_ns <= now:
                peripheral.tick()

    def reset(self) -> None:
        """Reset the chip, by the cause in `reset_by` (the pin, if none)."""
        self.rcc.reset_by(self.reset_by)
        self.reset_by = 0
        for name, peripheral in self.peripherals.items():
            if name != "RCC":
                peripheral.reset()
        self.nvic.reset()
        self.system.reset()

    def read(self, address: int, size: int) -> int:
        """Return the result of a load of 1, 2 or 4 bytes, 0 without a clock. Raises DeviceError without a register."""
        block = self._blocks.get(address // BLOCK)
        if block is None:
            raise _nothing_at(address)
        peripheral, start, register, mask = block
        if register and not self.rcc.words.get(register, 0) & mask:
            return 0
        if size == 4:
            return peripheral.read(address - start)
        return peripheral.read((address & ~3) - start) >> 8 * (address & 3) & (1 << 8 * size) - 1

    def write(self, address: int, size: int, value: int) -> None:
        """Store 1, 2 or 4 bytes; without effect where the clock is off. Raises DeviceError where no register is."""
        block = self._blocks.get(address // BLOCK)
        if block is None:
            raise _nothing_at(address)
        peripheral, start, register, mask = block
        if register and not self.rcc.words.get(register, 0) & mask:
            return
        offset = (address & ~3) - start
        if size < 4:
            shift, mask = 8 * (address & 3), (1 << 8 * size) - 1
            value = peripheral.words.get(offset, 0) & ~(mask << shift) | (value & mask) << shift
        peripheral.write(offset, value)

    def _lay_out(self) -> dict[int, tuple[Peripheral, int, int, int]]:
        """Return each block by number: its device, base address, and its clock's register and bit."""
        debug = Peripheral()  # trace, cycle counter: plain registers
        blocks: dict[int, tuple[Peripheral, int, int, int]] = {}
        blocks |= dict.fromkeys(_numbers(CORE_REGISTERS, CORE_REGISTERS_SIZE), (debug, CORE_REGISTERS, 0, 0))
        blocks |= dict.fromkeys(_numbers(SYSTEM_CONTROL, 4 * BLOCK), (self.system, SYSTEM_CONTROL, 0, 0))
        for name, (address, register, bit) in PLACES.items():
            blocks[address // BLOCK] = (self.peripherals[name], address, register, 1 << bit)
        return blocks

    def _line(self, interrupt: int) -> Callable[[bool], None]:
        return partial(self.nvic.set_line, FIRST_INTERRUPT + interrupt)

    def _make_usart(self, name: str, paced: bool) -> Usart:
        fast = PLACES[name].register == APB2ENR
        return Usart(
            self.time,
            (lambda: self.rcc.apb2_hz) if fast else (lambda: self.rcc.apb1_hz),
            self._line(USART_INTERRUPTS[name]),
            paced,
        )

    def _make_timer(self, name: str) -> Timer:
        fast = PLACES[name].register == APB2ENR
        return Timer(
            self.time,
            (lambda: self.rcc.apb2_timer_hz) if fast else (lambda: self.rcc.apb1_timer_hz),
            self._line(TIMER_INTERRUPTS[name]),
            gated=name in ADVANCED_TIMERS,
            bits=32 if name in WIDE_TIMERS else 16,
        )

    def _retime(self) -> None:
        for peripheral in self._timed:
            peripheral.retime()

    def _reset_blocks(self, register: int, bits: int) -> None:
        for name, place in PLACES.items():
            if place.register == register and bits >> place.bit & 1:
                self.peripherals[name].reset()

    def _program_resets(self) -> None:
        self.reset_by = SOFTWARE_RESET

    def _watchdog_resets(self) -> None:
        self.reset_by = WATCHDOG_RESET


def _numbers(start: int, size: int) -> range:
    return range(start // BLOCK, (start + size) // BLOCK)


def _nothing_at(address: int) -> DeviceError:
    return DeviceError(f"no register is at 0x{address:08x}")
