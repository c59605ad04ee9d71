"""Exceptions and sleep of the core (ARMv7-M Architecture Reference Manual, part B1.5).

Not modelled: execution time of instructions, fault handlers (a fault ends the emulation with a message), memory
protection unit, unprivileged mode.
"""

from mmap import mmap
from struct import Struct

from firmware_stub.emulation import engine
from firmware_stub.emulation.chip import Chip
from firmware_stub.emulation.engine import Engine, Registers
from firmware_stub.emulation.memory import FLASH, Memory
from firmware_stub.emulation.nvic import SVCALL

MAX_EXCEPTIONS = 512  # in a row before time advances

THUMB, FRAME_IS_ALIGNED = 1 << 24, 1 << 9  # bits of the program status
FLAGS = 0xF80F_0000
RETURN, ON_PROCESS_STACK, TO_THREAD, NO_FLOAT = 0xFFFF_FFE1, 4, 8, 16  # the value that returns from an exception
PROCESS_STACK, FLOAT_IN_USE = 2, 4  # bits of CONTROL
FRAME = Struct("<8I")
FLOAT_FRAME = Struct("<8QI4x")  # S0 to S15, FPSCR, a reserved word


class Core:
    """The core with its memory. While `sleeping` it waits for an exception that can preempt it.

    image: content of the flash, starting with the vector table. number: as in `Memory`. Raises MissingExtraError
    without Unicorn.
    """

    def __init__(self, chip: Chip, image: bytes, number: int = 0) -> None:
        self._chip = chip
        self._nvic = chip.nvic
        self._memory = Memory(image, chip.model, number)
        self._engine = Engine(chip, self._memory, self._would_interrupt, self._is_masked)
        self.sleeping = False
        self._event = False  # event register: set when an exception returns; the next WFE then does not wait

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
        self.sleeping = self._event = False

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
            self._handle_stop(reason)
            if self.sleeping or reason == engine.EXHAUSTED or self._chip.reset_by:
                return

    def _handle_stop(self, reason: int) -> None:
        """Handle the `reason` for which the engine stopped."""
        if reason == engine.WAIT_FOR_INTERRUPT:
            self.sleeping = not self._nvic.urgent
        elif reason == engine.EXCEPTION_RETURN:
            self._return(self._engine.pc | 1)
        elif reason == engine.SUPERVISOR_CALL:
            self._nvic.pend(1 << SVCALL)
        elif reason == engine.WAIT_FOR_EVENT:
            self.sleeping, self._event = not (self._event or self._nvic.urgent), False

    def _would_interrupt(self) -> bool:
        return self._nvic.urgent or bool(self._chip.reset_by)

    def _is_masked(self, registers: Registers) -> bool:
        if self._chip.reset_by:
            return False
        if registers.primask or registers.faultmask:
            return self._nvic.next_priority >= 0
        return bool(registers.basepri) and self._nvic.next_priority >= registers.basepri

    def _take_exception(self) -> None:
        """Take the next exception, unless it is masked."""
        registers = self._engine.read_registers()
        if self._is_masked(registers):
            return
        returns_with = RETURN | NO_FLOAT
        if registers.control & FLOAT_IN_USE:
            returns_with = RETURN
        if not self._nvic.active:
            returns_with |= TO_THREAD | (ON_PROCESS_STACK if registers.control & PROCESS_STACK else 0)
        self._enter(self._push(registers), registers.xpsr, returns_with)

    def _return(self, returns_with: int) -> None:
        """Return from an exception, to the next pending one if it can be taken, else to the interrupted code."""
        nvic = self._nvic
        nvic.leave()
        self._event = True
        registers = self._engine.read_registers()
        if nvic.urgent and not self._is_masked(registers):
            self._enter(registers.sp, registers.xpsr, returns_with)
            return
        self._pop(returns_with, registers)
        if returns_with & TO_THREAD and self._chip.system.sleep_on_exit:
            self.sleeping = not nvic.urgent

    def _enter(self, sp: int, status: int, returns_with: int) -> None:
        number = self._nvic.enter()
        self._engine.enter(self._vector(number), sp, status & FLAGS | THUMB | number, returns_with)

    def _vector(self, number: int) -> int:
        return self._memory.read_word((self._chip.system.vector_table or FLASH) + 4 * number)

    def _push(self, registers: Registers) -> int:
        """Save the registers that a handler may change; return the new stack pointer."""
        floats = registers.control & FLOAT_IN_USE
        top = registers.sp - FRAME.size - (FLOAT_FRAME.size if floats else 0)
        frame = top & ~7
        status = registers.xpsr & ~FRAME_IS_ALIGNED | (FRAME_IS_ALIGNED if frame != top else 0)
        memory, start = self._find(frame, registers.sp - frame)
        FRAME.pack_into(memory, start, *registers[:6], self._engine.pc, status)
        if floats:
            FLOAT_FRAME.pack_into(memory, start + FRAME.size, *self._engine.read_floats())
            self._engine.write_control(registers.control & ~FLOAT_IN_USE)
        return frame

    def _pop(self, returns_with: int, registers: Registers) -> None:
        """Restore the registers that `_push` saved."""
        on_process_stack = returns_with & ON_PROCESS_STACK
        sp = self._engine.read_process_stack() if on_process_stack else registers.sp
        frame = FRAME.unpack_from(*self._find(sp, FRAME.size))
        sp += FRAME.size
        control = registers.control & ~(PROCESS_STACK | FLOAT_IN_USE) | (PROCESS_STACK if on_process_stack else 0)
        if not returns_with & NO_FLOAT:
            self._engine.write_floats(FLOAT_FRAME.unpack_from(*self._find(sp, FLOAT_FRAME.size)))
            sp += FLOAT_FRAME.size
            control |= FLOAT_IN_USE
        if control != registers.control:
            self._engine.write_control(control)
        status = frame[-1]
        sp += 4 if status & FRAME_IS_ALIGNED else 0
        self._engine.leave((*frame[:-1], status & ~FRAME_IS_ALIGNED), sp)

    def _find(self, address: int, size: int) -> tuple[mmap, int]:
        place = self._memory.find(address, size)
        if place is None:
            raise self._engine.make_error(f"has no memory at 0x{address & 0xFFFF_FFFF:08x}")
        return place
