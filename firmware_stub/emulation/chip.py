"""An STM32 around its core: peripherals at their addresses, clock enables, and resets."""

from collections.abc import Callable
from functools import partial

from firmware_stub.emulation.bxcan import BxCan
from firmware_stub.emulation.iwdg import Iwdg
from firmware_stub.emulation.models import BLOCK, F405, Model
from firmware_stub.emulation.nvic import FIRST_INTERRUPT, Nvic
from firmware_stub.emulation.peripheral import Peripheral, Time
from firmware_stub.emulation.rcc import Rcc, RccF1
from firmware_stub.emulation.system import SystemControl
from firmware_stub.emulation.timer import Timer
from firmware_stub.emulation.usart import Usart
from hil.common.errors import DeviceError

PERIPHERALS, PERIPHERALS_SIZE = 0x4000_0000, 0x8_0000
CORE_REGISTERS, CORE_REGISTERS_SIZE = 0xE000_0000, 0x10_0000
SYSTEM_CONTROL = 0xE000_E000
CAN1_INTERRUPTS = (19, 20)  # transmit, FIFO 0
USART_INTERRUPTS = {"USART1": 37, "USART2": 38}
TIMERS = ("TIM3", "TIM4")  # of the outputs, with four channels each: thrusters 1 to 4 and 5 to 8
RCCS = {"f4": Rcc, "f1": RccF1}


class Chip:
    """The peripherals by name, their registers by address, and the time of their next event.

    has_expired: whether the watchdog has requested a reset. paced: whether bytes take time on the serial line. model:
    the type of STM32.
    """

    def __init__(self, paced: bool, model: Model = F405) -> None:
        self.model = model
        self.time = Time()
        self.nvic = Nvic()
        self.has_expired = False
        self.rcc: Rcc = RCCS[model.family]()
        self.system = SystemControl(self.time, self.nvic, lambda: self.rcc.core_hz)
        self.iwdg = Iwdg(self.time, self._request_reset)
        self.can = BxCan(*(self._line(number) for number in CAN1_INTERRUPTS))
        bus_hz = (lambda: self.rcc.apb2_hz) if model.usart == "USART1" else (lambda: self.rcc.apb1_hz)
        self.usart = Usart(self.time, bus_hz, self._line(USART_INTERRUPTS[model.usart]), paced)
        self.timers = {name: Timer(lambda: self.rcc.apb1_timer_hz) for name in TIMERS}
        self.peripherals: dict[str, Peripheral] = {name: Peripheral() for name in model.peripherals}
        self.peripherals |= self.timers | {"RCC": self.rcc, "IWDG": self.iwdg, model.usart: self.usart}
        if "CAN1" in model.peripherals:
            self.peripherals["CAN1"] = self.can
        self._timed = [self.system, self.iwdg, self.usart]
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
        """Reset the chip."""
        self.has_expired = False
        for peripheral in self.peripherals.values():
            peripheral.reset()
        self.nvic.reset()
        self.system.reset()

    def read(self, address: int, size: int) -> int:
        """Load 1, 2 or 4 bytes; 0 if the peripheral's clock is off. Raises DeviceError if there is no register."""
        peripheral, start, register, mask = self._block(address)
        if register and not self.rcc.registers.get(register, 0) & mask:
            return 0
        if size == 4:
            return peripheral.read(address - start)
        return peripheral.read((address & ~3) - start) >> 8 * (address & 3) & (1 << 8 * size) - 1

    def write(self, address: int, size: int, value: int) -> None:
        """Store 1, 2 or 4 bytes; no effect if the peripheral's clock is off. Raises DeviceError without a register."""
        peripheral, start, register, mask = self._block(address)
        if register and not self.rcc.registers.get(register, 0) & mask:
            return
        offset = (address & ~3) - start
        if size < 4:
            shift, mask = 8 * (address & 3), (1 << 8 * size) - 1
            value = peripheral.registers.get(offset, 0) & ~(mask << shift) | (value & mask) << shift
        peripheral.write(offset, value)

    def _block(self, address: int) -> tuple[Peripheral, int, int, int]:
        """Return the peripheral at an address, its base address, and the register and mask of its clock enable."""
        block = self._blocks.get(address // BLOCK)
        if block is None:
            raise DeviceError(f"no register is at 0x{address:08x}")
        return block

    def _map_blocks(self) -> dict[int, tuple[Peripheral, int, int, int]]:
        """Return by block number what `_block` returns."""
        blocks: dict[int, tuple[Peripheral, int, int, int]] = {
            SYSTEM_CONTROL // BLOCK + i: (self.system, SYSTEM_CONTROL, 0, 0) for i in range(4)
        }
        for name, (address, register, bit) in self.model.peripherals.items():
            blocks[address // BLOCK] = (self.peripherals[name], address, register, 1 << bit)
        return blocks

    def _line(self, interrupt: int) -> Callable[[bool], None]:
        return partial(self.nvic.set_line, FIRST_INTERRUPT + interrupt)

    def _request_reset(self) -> None:
        self.has_expired = True
