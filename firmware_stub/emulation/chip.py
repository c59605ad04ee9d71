"""An STM32 around its core: peripherals at their addresses, clock enables, and resets."""

from collections.abc import Callable
from functools import partial

from firmware_stub.emulation.bxcan import BxCan
from firmware_stub.emulation.iwdg import Iwdg
from firmware_stub.emulation.models import BLOCK, F405, Model
from firmware_stub.emulation.nvic import FIRST_INTERRUPT, Nvic
from firmware_stub.emulation.peripheral import Peripheral, Time
from firmware_stub.emulation.rcc import SOFTWARE_RESET, WATCHDOG_RESET, Rcc, RccF1
from firmware_stub.emulation.system import SystemControl
from firmware_stub.emulation.timer import Timer
from firmware_stub.emulation.usart import Usart
from hil.common.errors import DeviceError

PERIPHERALS, PERIPHERALS_SIZE = 0x4000_0000, 0x8_0000
CORE_REGISTERS, CORE_REGISTERS_SIZE = 0xE000_0000, 0x10_0000
SYSTEM_CONTROL = 0xE000_E000


ADVANCED_TIMERS, WIDE_TIMERS = ("TIM1", "TIM8"), ("TIM2", "TIM5")  # of an F4; an F1's count to 16 bits
CAN1_INTERRUPTS = (19, 20, 21)  # transmit, FIFO 0, FIFO 1
DEVICE_ID = 0x4_2000  # DBGMCU_IDCODE, from CORE_REGISTERS on
RCCS = {"f4": Rcc, "f1": RccF1}


class Chip:
    """The peripherals by name, their registers by address, and the time of their next event.

    reset_by: flag of the cause when the program or the watchdog has requested a reset, otherwise 0. paced: whether
    bytes take time on the serial lines. model: the type of STM32.
    """

    def __init__(self, paced: bool, model: Model = F405) -> None:
        self.model = model
        self.time = Time()
        self.nvic = Nvic()
        self.reset_by = 0
        self.rcc: Rcc = RCCS[model.family](self._retime, self._reset_blocks)
        self.system = SystemControl(self.time, self.nvic, lambda: self.rcc.core_hz, self._request_software_reset)
        self.iwdg = Iwdg(self.time, self._request_watchdog_reset)
        self.can = BxCan(*(self._line(number) for number in CAN1_INTERRUPTS))
        self.usarts = {name: self._make_usart(name, paced) for name in model.usarts}
        self.timers = {name: self._make_timer(name) for name in model.timers}
        self.peripherals: dict[str, Peripheral] = {name: Peripheral() for name in model.peripherals}
        self.peripherals |= self.usarts | self.timers | {"RCC": self.rcc, "IWDG": self.iwdg}
        if "CAN1" in model.peripherals:
            self.peripherals["CAN1"] = self.can
        self._timed = [self.system, self.iwdg, *self.usarts.values(), *self.timers.values()]
        self._blocks = self._map_blocks()

    @property
    def due_ns(self) -> int:
        """Time (ns) of the peripherals' next event, at which `tick` must be called."""
        return min([peripheral.due_ns for peripheral in self._timed])

    def tick(self) -> None:
        """Run the peripherals that are due now."""
        now = self.time.now_ns
        for peripheral in self._timed:
            if peripheral.due_ns <= now:
                peripheral.tick()

    def reset(self) -> None:
        """Reset the chip with the cause in `reset_by`; 0 is the reset pin."""
        self.rcc.reset_by(self.reset_by)
        self.reset_by = 0
        for name, peripheral in self.peripherals.items():
            if name != "RCC":
                peripheral.reset()
        self.nvic.reset()
        self.system.reset()

    def read(self, address: int, size: int) -> int:
        """Load 1, 2 or 4 bytes; 0 if the peripheral's clock is off. Raises DeviceError if there is no register."""
        block = self._blocks.get(address // BLOCK)
        if block is None:
            raise _no_register_error(address)
        peripheral, start, register, mask = block
        if register and not self.rcc.registers.get(register, 0) & mask:
            return 0
        if size == 4:
            return peripheral.read(address - start)
        return peripheral.read((address & ~3) - start) >> 8 * (address & 3) & (1 << 8 * size) - 1

    def write(self, address: int, size: int, value: int) -> None:
        """Store 1, 2 or 4 bytes; no effect if the peripheral's clock is off. Raises DeviceError without a register."""
        block = self._blocks.get(address // BLOCK)
        if block is None:
            raise _no_register_error(address)
        peripheral, start, register, mask = block
        if register and not self.rcc.registers.get(register, 0) & mask:
            return
        offset = (address & ~3) - start
        if size < 4:
            shift, mask = 8 * (address & 3), (1 << 8 * size) - 1
            value = peripheral.registers.get(offset, 0) & ~(mask << shift) | (value & mask) << shift
        peripheral.write(offset, value)

    def _map_blocks(self) -> dict[int, tuple[Peripheral, int, int, int]]:
        """Return by block number the peripheral, its base address, and the register and mask of its clock enable."""
        debug = Peripheral()  # trace, cycle counter: plain registers
        debug.registers[DEVICE_ID] = self.model.device_id
        blocks: dict[int, tuple[Peripheral, int, int, int]] = {}
        blocks |= dict.fromkeys(_numbers(CORE_REGISTERS, CORE_REGISTERS_SIZE), (debug, CORE_REGISTERS, 0, 0))
        blocks |= dict.fromkeys(_numbers(SYSTEM_CONTROL, 4 * BLOCK), (self.system, SYSTEM_CONTROL, 0, 0))
        for name, (address, register, bit) in self.model.peripherals.items():
            blocks[address // BLOCK] = (self.peripherals[name], address, register, 1 << bit)
        return blocks

    def _line(self, interrupt: int) -> Callable[[bool], None]:
        return partial(self.nvic.set_line, FIRST_INTERRUPT + interrupt)

    def _make_usart(self, name: str, paced: bool) -> Usart:
        fast = self.model.peripherals[name].register == self.model.apb2_enable
        return Usart(
            self.time,
            (lambda: self.rcc.apb2_hz) if fast else (lambda: self.rcc.apb1_hz),
            self._line(self.model.usarts[name]),
            paced,
        )

    def _make_timer(self, name: str) -> Timer:
        fast = self.model.peripherals[name].register == self.model.apb2_enable
        return Timer(
            self.time,
            (lambda: self.rcc.apb2_timer_hz) if fast else (lambda: self.rcc.apb1_timer_hz),
            self._line(self.model.timers[name]),
            gated=name in ADVANCED_TIMERS,
            bits=32 if name in WIDE_TIMERS and self.model.family == "f4" else 16,
        )

    def _retime(self) -> None:
        for peripheral in self._timed:
            peripheral.retime()

    def _reset_blocks(self, register: int, bits: int) -> None:
        for name, place in self.model.peripherals.items():
            if place.register == register and bits >> place.bit & 1:
                self.peripherals[name].reset()

    def _request_software_reset(self) -> None:
        self.reset_by = SOFTWARE_RESET

    def _request_watchdog_reset(self) -> None:
        self.reset_by = WATCHDOG_RESET


def _numbers(start: int, size: int) -> range:
    return range(start // BLOCK, (start + size) // BLOCK)


def _no_register_error(address: int) -> DeviceError:
    return DeviceError(f"no register is at 0x{address:08x}")
