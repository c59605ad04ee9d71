"""Execution of instructions by Unicorn, which stops where the core may have to take an exception or sleep.

It stops after a store to a peripheral, after an instruction that unmasks interrupts, at a return from an exception, and
before the core sleeps. The only M-profile core of Unicorn 2.1 is a Cortex-M33, which executes all instructions of a
Cortex-M4.

Not modelled: unmasking interrupts and sleeping by code in RAM. A pending exception is then taken at the next other
stop, and the core does not sleep.
"""

import importlib
from collections.abc import Callable
from ctypes import addressof, c_int, c_uint32, c_void_p
from typing import Any, NamedTuple

from firmware_stub.emulation.chip import CORE_REGISTERS, CORE_REGISTERS_SIZE, PERIPHERALS, PERIPHERALS_SIZE, Chip
from firmware_stub.emulation.memory import FLASH, Memory
from hil.common.errors import DeviceError, MissingExtraError

# Reasons of a stop. The positive ones are Unicorn's own numbers.
EXHAUSTED, INTERRUPTED, WAIT_FOR_INTERRUPT = 0, -1, -2
BREAKPOINT, EXCEPTION_RETURN = 7, 8

NEVER_REACHED = 0xFFFF_FFFE  # end address of an execution that only stops on request
WFI, CPSIE_I = b"\x30\xbf", b"\x62\xb6"
# By Unicorn's code.
INVALID_ACCESSES = {19: "read", 20: "wrote", 21: "executed", 22: "wrote", 23: "read", 24: "executed"}

READ = ("R0", "R1", "R2", "R3", "R12", "LR", "PC", "XPSR", "SP", "PRIMASK")
ENTER = ("SP", "XPSR_NZCVQG", "LR")  # the order matters: the status selects the stack pointer
LEAVE = ("XPSR_NZCVQG", "SP", "R0", "R1", "R2", "R3", "R12", "LR")


class Registers(NamedTuple):
    """The registers of the core that exceptions need."""

    r0: int
    r1: int
    r2: int
    r3: int
    r12: int
    lr: int
    pc: int
    xpsr: int
    sp: int
    primask: int


class _Batch:
    """Batch of registers that are read or written at once.

    Unicorn's own batches take ten times as long, because they allocate new arrays for each access.
    """

    def __init__(self, uc: Any, numbers: list[int]) -> None:
        self._uc = uc
        self._numbers = (c_int * len(numbers))(*numbers)
        self._values = (c_uint32 * len(numbers))()
        self._size = c_int(len(numbers))
        start = addressof(self._values)
        self._addresses = (c_void_p * len(numbers))(*(start + 4 * i for i in range(len(numbers))))

    def read(self) -> list[int]:
        self._uc._do_reg_read_batch(self._numbers, self._addresses, self._size)
        return self._values[:]

    def write(self, *values: int) -> None:
        self._values[:] = list(values)
        self._uc._do_reg_write_batch(self._numbers, self._addresses, self._size)


class Engine:
    """Executes instructions, beginning at `pc`, the address of the last stop.

    would_interrupt: returns whether an exception is pending that interrupts the program if it is not masked, or a
    reset. Raises MissingExtraError without Unicorn.
    """

    def __init__(self, chip: Chip, memory: Memory, would_interrupt: Callable[[], bool]) -> None:
        self._unicorn, names = _load_unicorn()
        self._chip = chip
        self._memory = memory
        self._would_interrupt = would_interrupt
        self._uc = uc = self._unicorn.Uc(
            self._unicorn.UC_ARCH_ARM, self._unicorn.UC_MODE_THUMB | self._unicorn.UC_MODE_MCLASS
        )
        self._register = {name: getattr(names, f"UC_ARM_REG_{name}") for name in (*READ, *LEAVE)}
        self._read, self._enter, self._leave, self._program_counter = (
            _Batch(uc, [self._register[name] for name in some]) for some in (READ, ENTER, LEAVE, ("PC",))
        )
        self._map()
        self._hook()
        self._at_power_up = uc.context_save()
        self._stopped_by = EXHAUSTED
        self._fault = ""
        self._raised: BaseException | None = None  # by a peripheral's read or write
        self.pc = 0

    def reset(self, pc: int, sp: int, status: int) -> None:
        """Set all registers as after a reset, except these three."""
        self._uc.context_restore(self._at_power_up)
        self.enter(pc, sp, status, 0xFFFF_FFFF)

    def run(self, instructions: int) -> int:
        """Execute at most `instructions`; return the reason of the stop. Raises DeviceError for a fault."""
        self._stopped_by = EXHAUSTED
        try:
            self._uc.emu_start(self.pc | 1, NEVER_REACHED, 0, instructions)
        except self._unicorn.UcError as error:
            raise self.make_error(self._fault or f"stopped ({error})") from None
        if self._raised:
            raised, self._raised = self._raised, None
            raise raised
        if self._fault:
            raise self.make_error(self._fault)
        self.pc = self._program_counter.read()[0]
        if self._stopped_by == WAIT_FOR_INTERRUPT:
            self.pc += len(WFI)  # Unicorn stops before the WFI
        return self._stopped_by

    def execute_unmask(self) -> None:
        """Execute the next instruction if it is CPSIE i, without Unicorn, whose start takes far longer."""
        if self._memory.read_code(self.pc, len(CPSIE_I)) == CPSIE_I:
            self._uc.reg_write(self._register["PRIMASK"], 0)
            self.pc += len(CPSIE_I)

    def read_registers(self) -> Registers:
        """Return the present registers."""
        return Registers._make(self._read.read())

    def enter(self, pc: int, sp: int, status: int, lr: int) -> None:
        """Continue at the beginning of a handler."""
        self._enter.write(sp, status, lr)
        self.pc = pc & ~1

    def leave(self, frame: tuple[int, ...], sp: int) -> None:
        """Continue with the registers of a saved frame: r0 to r3, r12, lr, pc, status."""
        *low, lr, pc, status = frame
        self._leave.write(status, sp, *low, lr)
        self.pc = pc & ~1

    def write_memory(self, address: int, data: bytes) -> None:
        """Write memory, including flash; discard its translated code."""
        self._uc.mem_write(address, data)
        self._uc.ctl_remove_cache(address & ~1, address + len(data))

    def make_error(self, what: str) -> DeviceError:
        """Return an error that tells what the program did, with its position and registers."""
        self._fault = ""
        r = self.read_registers()
        return DeviceError(
            f"the emulated STM32 {what} at pc 0x{r.pc:08x} (lr 0x{r.lr:08x}, sp 0x{r.sp:08x}, r0 to r3 "
            f"0x{r.r0:x} 0x{r.r1:x} 0x{r.r2:x} 0x{r.r3:x}); look pc and lr up with arm-none-eabi-addr2line"
        )

    # ---- callbacks of Unicorn. It prints and drops Python exceptions of callbacks, so they are stored for `run`.

    def _load(self, _: Any, offset: int, size: int, base: int) -> int:
        try:
            return self._chip.read(base + offset, size)
        except DeviceError as error:
            self._stop_by_fault(f"read {size} bytes: {error}")
        except BaseException as error:  # noqa: BLE001 - `run` raises it
            self._store_error(error)
        return 0

    def _store(self, _: Any, offset: int, size: int, value: int, base: int) -> None:
        try:
            self._chip.write(base + offset, size, value)
            if self._would_interrupt():
                self._stop_after_store()
        except DeviceError as error:
            self._stop_by_fault(f"wrote 0x{value:x}: {error}")
        except BaseException as error:  # noqa: BLE001 - `run` raises it
            self._store_error(error)

    def _stop_after_store(self) -> None:
        """Stop after the present store. Unicorn would repeat it, so it must not change registers; others do not
        stop."""
        registers = self.read_registers()
        size = plain_store_size(self._memory.read_code(registers.pc, 4))
        if size and not self._is_masked(registers):
            self._uc.reg_write(self._register["PC"], registers.pc + size | 1)
            self._stop(INTERRUPTED)

    def _on_unmask(self, *_: Any) -> None:
        if self._would_interrupt() and not self._is_masked(self.read_registers()):
            self._stop(INTERRUPTED)

    def _is_masked(self, registers: Registers) -> bool:
        return bool(registers.primask) and not self._chip.has_expired

    def _on_wait(self, *_: Any) -> None:
        self._stop(WAIT_FOR_INTERRUPT)

    def _on_exception(self, _: Any, number: int, __: Any) -> None:
        self._stop(number)
        if number != EXCEPTION_RETURN:
            self._fault = "executed a breakpoint" if number == BREAKPOINT else f"raised exception {number}"

    def _on_unknown_instruction(self, _: Any, __: Any) -> bool:
        self._fault = "executed an invalid instruction"
        return False

    def _on_invalid_access(self, _: Any, access: int, address: int, size: int, value: int, __: Any) -> bool:
        what = f" (0x{value:x})" if INVALID_ACCESSES[access] == "wrote" else ""
        self._fault = f"{INVALID_ACCESSES[access]} {size} bytes{what} at 0x{address:08x}, which is not allowed,"
        return False

    def _stop_by_fault(self, fault: str) -> None:
        self._fault = fault
        self._uc.emu_stop()

    def _store_error(self, error: BaseException) -> None:
        self._raised = error
        self._uc.emu_stop()

    def _stop(self, reason: int) -> None:
        self._stopped_by = reason
        self._uc.emu_stop()

    # ---- opening

    def _map(self) -> None:
        uc = self._uc
        for start, size, rights, host_address in self._memory.mappings():
            uc.mem_map_ptr(start, size, rights, host_address)
        # `Uc.mmio_map` adds two calls to each access, which would take a quarter of the time of a command.
        binding = importlib.import_module("unicorn.unicorn_py3.unicorn")
        # Stored, so that they are not freed.
        self._accesses = binding.MMIO_READ_CFUNC(self._load), binding.MMIO_WRITE_CFUNC(self._store)
        load, store = self._accesses
        for start, size in ((PERIPHERALS, PERIPHERALS_SIZE), (CORE_REGISTERS, CORE_REGISTERS_SIZE)):
            error = binding.uclib.uc_mmio_map(uc._uch, start, size, load, start, store, start)
            if error:
                raise self._unicorn.UcError(error)

    def _hook(self) -> None:
        uc, kinds = self._uc, self._unicorn
        uc.hook_add(kinds.UC_HOOK_INTR, self._on_exception)
        uc.hook_add(kinds.UC_HOOK_INSN_INVALID, self._on_unknown_instruction)
        uc.hook_add(kinds.UC_HOOK_MEM_INVALID, self._on_invalid_access)
        unmasks, waits = find_stops(self._memory.image)
        for offsets, callback in ((unmasks, self._on_unmask), (waits, self._on_wait)):
            for offset in offsets:
                uc.hook_add(kinds.UC_HOOK_CODE, callback, None, FLASH + offset, FLASH + offset)


def _load_unicorn() -> tuple[Any, Any]:
    try:
        return importlib.import_module("unicorn"), importlib.import_module("unicorn.arm_const")
    except ImportError:
        raise MissingExtraError(
            "an emulated STM32 (stm32 = \"unicorn\") needs Unicorn: pip install 'uuv-hil[unicorn]'"
        ) from None


def find_stops(program: bytes) -> tuple[list[int], list[int]]:
    """Return the offsets after each CPSIE i, and those of each WFI.

    Data that look like such an instruction add offsets that are never executed.
    """
    places = range(0, len(program) - 1, 2)
    unmasks = [i + 2 for i in places if program[i : i + 2] == CPSIE_I]
    return unmasks, [i for i in places if program[i : i + 2] == WFI]


def plain_store_size(code: bytes) -> int:
    """Return the size of a store that changes no register; 0 for any other instruction (ARMv7-M, A5.2, A5.3.10)."""
    first, second = int.from_bytes(code[:2], "little"), int.from_bytes(code[2:4], "little")
    if first >> 11 in (0b01100, 0b01110, 0b10000, 0b10010) or first >> 9 in (0b0101000, 0b0101001, 0b0101010):
        return 2
    if first & 0xFFF0 in (0xF8C0, 0xF880, 0xF8A0):
        return 4
    writes_back = second & 0x0800 and second & 0x0100
    return 4 if first & 0xFFF0 in (0xF840, 0xF800, 0xF820) and not writes_back else 0
