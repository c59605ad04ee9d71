"""Exceptions and sleep of the core (ARMv7-M Architecture Reference Manual, part B1.5).

Not modelled: execution time of instructions, fault handlers (a fault ends the emulation with a message), a second
stack, and floats in programs that are interrupted.
"""

from mmap import mmap
from struct import Struct

from firmware_stub.emulation import engine
from firmware_stub.emulation.chip import Chip
from firmware_stub.emulation.engine import Engine, Registers
from firmware_stub.emulation.memory import FLASH, Memory

MAX_EXCEPTIONS = 512  # in a row before time advances

THUMB, FRAME_IS_ALIGNED = 1 << 24, 1 << 9  # bits of the program status
FLAGS = 0xF80F_0000
RETURN = 0xFFFF_FFF9  # the value that returns from an exception to the program
FRAME = Struct("<8I")


class Core:
    """The core with its memory. While `sleeping` it waits for an exception.

    image: content of the flash, starting with the vector table. Raises MissingExtraError without Unicorn.
    """

    def __init__(self, chip: Chip, image: bytes) -> None:
        self._chip = chip
        self._nvic = chip.nvic
        self._memory = Memory(image, chip.model)
        self._engine = Engine(chip, self._memory, self._would_interrupt)
        self.sleeping = False

    @property
    def pc(self) -> int:
        """Address of the next instruction."""
        return self._engine.pc

    def read_memory(self, address: int, size: int) -> bytes:
        """Read memory like a debug probe. Raises DeviceError if there is no memory at that address."""
        memory, start = self._find(address, size)
        return memory[start : start + size]

    def write_memory(self, address: int, data: bytes) -> None:
        """Write memory, including flash, like a debug probe. Raises DeviceError if there is none at that address."""
        self._find(address, len(data))
        self._engine.write_memory(address, data)

    def reset(self) -> None:
        """Start at the reset vector; RAM keeps its contents."""
        self._engine.reset(self._vector(1), self._vector(0), THUMB)
        self.sleeping = False

    def run(self, instructions: int) -> None:
        """Execute until the core sleeps, has executed that many instructions in a row, or a reset is requested.

        Raises DeviceError when the program causes a fault.
        """
        if self.sleeping:
            if not self._nvic.urgent:
                return
            self.sleeping = False
            self._engine.execute_unmask()  # programs check for work, and sleep, with interrupts off
        for _ in range(MAX_EXCEPTIONS):
            if self._nvic.urgent:
                self._take_exception()
            reason = self._engine.run(instructions)
            if reason == engine.WAIT_FOR_INTERRUPT:
                self.sleeping = not self._nvic.urgent
            elif reason == engine.EXCEPTION_RETURN:
                self._return()
            if self.sleeping or reason == engine.EXHAUSTED or self._chip.has_expired:
                return

    def _would_interrupt(self) -> bool:
        return self._nvic.urgent or self._chip.has_expired

    def _take_exception(self) -> None:
        """Take the next exception, unless exceptions are masked."""
        registers = self._engine.read_registers()
        if not registers.primask:
            self._enter(self._push(registers), registers.xpsr)

    def _return(self) -> None:
        """Return from an exception, to the next pending one if it can be taken, else to the interrupted code."""
        self._nvic.leave()
        registers = self._engine.read_registers()
        if self._nvic.urgent and not registers.primask:
            self._enter(registers.sp, registers.xpsr)
        else:
            self._pop(registers.sp)

    def _enter(self, sp: int, status: int) -> None:
        number = self._nvic.enter()
        self._engine.enter(self._vector(number), sp, status & FLAGS | THUMB | number, RETURN)

    def _vector(self, number: int) -> int:
        return self._memory.read_word(FLASH + 4 * number)

    def _push(self, registers: Registers) -> int:
        """Save the registers that a handler may change; return the new stack pointer."""
        top = registers.sp - FRAME.size
        frame = top & ~7
        status = registers.xpsr & ~FRAME_IS_ALIGNED | (FRAME_IS_ALIGNED if frame != top else 0)
        memory, start = self._find(frame, registers.sp - frame)
        FRAME.pack_into(memory, start, *registers[:6], self._engine.pc, status)
        return frame

    def _pop(self, sp: int) -> None:
        """Restore the registers that `_push` saved."""
        frame = FRAME.unpack_from(*self._find(sp, FRAME.size))
        status = frame[-1]
        sp += FRAME.size + (4 if status & FRAME_IS_ALIGNED else 0)
        self._engine.leave((*frame[:-1], status & ~FRAME_IS_ALIGNED), sp)

    def _find(self, address: int, size: int) -> tuple[mmap, int]:
        place = self._memory.find(address, size)
        if place is None:
            raise self._engine.make_error(f"has no memory at 0x{address & 0xFFFF_FFFF:08x}")
        return place
