"""A debug probe for pyOCD with an emulated STM32 behind it: memory, core registers, flash controller; no USB.

The chip executes what pyOCD loads into its RAM, so that pyOCD's flash algorithms really run. Modelled of the flash
controllers are keys, sector or page erase, programming and their busy flag, which is never set. Source: ARMv7-M
Architecture Reference Manual, C1.6 (debug registers); ADIv5 (identification); RM0090 section 3.9, RM0008 and PM0075.
"""

from collections.abc import Sequence
from importlib import import_module
from typing import Any

from pyocd.core.exceptions import TransferError
from pyocd.core.memory_interface import MemoryInterface
from pyocd.probe.debug_probe import DebugProbe

from firmware_stub.emulation.models import MODELS

unicorn: Any = import_module("unicorn")  # which has no types
arm_const: Any = import_module("unicorn.arm_const")

FLASH, RAM, FPEC = 0x0800_0000, 0x2000_0000, {"f1": 0x4002_2000, "f4": 0x4002_3C00}
WATCHDOG = 0x4000_3000
ROM_TABLE, SCS, DEVICE_ID = 0xE00F_F000, 0xE000_E000, 0xE004_2000
CPUID, AIRCR, DHCSR, DCRSR, DCRDR = 0xE000_ED00, 0xE000_ED0C, 0xE000_EDF0, 0xE000_EDF4, 0xE000_EDF8
CPUIDS = {"f1": 0x411F_C231, "f4": 0x410F_C241}
KEYS = (0x4567_0123, 0xCDEF_89AB)
IDLE = 0x0002_0000  # S_HALT
COMPONENT = {0xFF0: 0x0D, 0xFF8: 0x05, 0xFFC: 0xB1}
GENERAL = [f"UC_ARM_REG_R{i}" for i in range(13)]
REGISTERS = [
    *GENERAL,
    "UC_ARM_REG_SP",
    "UC_ARM_REG_LR",
    "UC_ARM_REG_PC",
    "UC_ARM_REG_XPSR",
    "UC_ARM_REG_MSP",
    "UC_ARM_REG_PSP",
]


class FakeChip:
    """An STM32 as a debugger sees it. `flash` is its contents; `erased` the addresses whose sectors were erased."""

    def __init__(self, name: str, device_id: int | None = None) -> None:
        self.model = MODELS[name]
        self.device_id = self.model.device_id if device_id is None else device_id
        self.flash = bytearray(b"\x55" * self.model.flash_size)  # an old program
        self.erased: list[int] = []
        self.is_worn_out = False  # programming then changes nothing
        self.resets = 0
        self._halted = False
        self._sleeps = False
        self._dcrdr = 0
        self._words = {CPUID: CPUIDS[self.model.family], DEVICE_ID: self.device_id | 0x1000_0000}
        self._fpec: dict[int, int] = {}
        self._keys: list[int] = []
        self._locked = True
        self._uc: Any = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        uc = self._uc
        uc.mem_map(RAM, self.model.ram[RAM])
        uc.mmio_map(FLASH, self.model.flash_size, self._read_flash, None, self._program, None)
        uc.mem_map(WATCHDOG, 0x1000)  # which an algorithm slows down
        base = FPEC[self.model.family]
        uc.mmio_map(base & ~0xFFF, 0x1000, self._read_fpec, base & 0xFFF, self._write_fpec, base & 0xFFF)

    # ---- memory by the debugger

    def read(self, address: int, size: int) -> bytes:
        if FLASH <= address < FLASH + len(self.flash):
            return bytes(self.flash[address - FLASH : address - FLASH + size])
        if RAM <= address < RAM + self.model.ram[RAM]:
            return bytes(self._uc.mem_read(address, size))
        word = self._read_word(address & ~3).to_bytes(4, "little")
        return word[address & 3 :][:size]

    def write(self, address: int, data: bytes) -> None:
        if RAM <= address < RAM + self.model.ram[RAM]:
            self._uc.mem_write(address, data)
        elif len(data) == 4:
            self._write_word(address, int.from_bytes(data, "little"))

    def _read_word(self, address: int) -> int:
        if address == DHCSR:
            return 1 | 0x0001_0000 | (IDLE if self._halted else 0)  # S_REGRDY
        if address == DCRDR:
            return self._dcrdr
        if address == ROM_TABLE:
            return (SCS - ROM_TABLE) & 0xFFFF_F000 | 3
        for base, cidr1, part in ((ROM_TABLE, 0x10, 0x4C4), (SCS, 0xE0, 0x00C if self.model.family == "f4" else 0)):
            if base + 0xFD0 <= address < base + 0x1000:
                identity = {0xFF4: cidr1, 0xFE0: part & 0xFF, 0xFE4: 0xB0 | part >> 8, 0xFE8: 0x0B, 0xFD0: 4}
                return (COMPONENT | identity).get(address - base, 0)
        return self._words.get(address, 0)

    def _write_word(self, address: int, value: int) -> None:
        if address == DHCSR and value >> 16 == 0xA05F:
            was, self._halted = self._halted, bool(value & 2)
            if was and not self._halted:
                self._run()
        elif address == DCRSR:
            self._transfer(value)
        elif address == DCRDR:
            self._dcrdr = value
        elif address == AIRCR and value & 4:
            self.reset()
        else:
            self._words[address] = value

    def reset(self) -> None:
        self.resets += 1
        self._locked, self._keys, self._fpec = True, [], {}
        self._halted = bool(self._words.get(0xE000_EDFC, 0) & 1)  # DEMCR.VC_CORERESET

    # ---- the core

    def _transfer(self, value: int) -> None:
        number = value & 0x7F
        if number >= len(REGISTERS):
            self._dcrdr = 0 if not value >> 16 else self._dcrdr
            return
        register = getattr(arm_const, REGISTERS[number])
        if value >> 16 & 1:
            self._uc.reg_write(register, self._dcrdr | 1 if number == 15 else self._dcrdr)
        else:
            self._dcrdr = self._uc.reg_read(register)
            if number == 16:
                self._dcrdr |= 1 << 24

    def _run(self) -> None:
        """Run until a breakpoint, the end of an algorithm's function. A program in flash is not run."""
        pc = self._uc.reg_read(arm_const.UC_ARM_REG_PC)
        if not RAM <= pc < RAM + self.model.ram[RAM]:
            return
        hook = self._uc.hook_add(unicorn.UC_HOOK_INTR, lambda uc, *_: uc.emu_stop())
        self._uc.emu_start(pc | 1, 0xFFFF_FFFE, 0, 50_000_000)
        self._uc.hook_del(hook)
        self._halted = True

    # ---- the flash, as the algorithm sees it

    def _read_flash(self, _: Any, offset: int, size: int, __: Any) -> int:
        return int.from_bytes(self.flash[offset : offset + size], "little")

    def _program(self, _: Any, offset: int, size: int, value: int, __: Any) -> None:
        control = self._fpec.get(0x10, 0)
        if self._locked or not control & 1:
            raise AssertionError(f"flash written at {offset:#x} without permission")
        if self.is_worn_out:
            return
        old = int.from_bytes(self.flash[offset : offset + size], "little")
        self.flash[offset : offset + size] = (old & value).to_bytes(size, "little")

    def _read_fpec(self, _: Any, offset: int, size: int, base: int) -> int:
        register = offset - base
        if register == 0x10:
            lock = 1 << 31 if self.model.family == "f4" else 1 << 7
            return self._fpec.get(0x10, 0) & ~lock | (lock if self._locked else 0)
        return self._fpec.get(register, 0)

    def _write_fpec(self, _: Any, offset: int, size: int, value: int, base: int) -> None:
        register = offset - base
        if register == 4:
            self._keys = [*self._keys, value][-2:]
            self._locked = self._locked and tuple(self._keys) != KEYS
        elif register == 0x10:
            self._control(value)
        elif register != 0x0C:  # the status: flags are cleared by writing them
            self._fpec[register] = value

    def _control(self, value: int) -> None:
        if self._locked:
            return
        f4 = self.model.family == "f4"
        start, erase, lock = (1 << 16, 1 << 1, 1 << 31) if f4 else (1 << 6, 1 << 1, 1 << 7)
        self._fpec[0x10] = value & ~(start | lock)
        self._locked = bool(value & lock)
        if value & start and value & erase:
            if f4:
                number = value >> 3 & 15
                first, size = (number << 14, 1 << 14) if number < 4 else (1 << 16, 1 << 16)
                if number > 4:
                    first, size = (number - 4) << 17, 1 << 17
            else:
                first, size = self._fpec[0x14] - FLASH & ~0x3FF, 1 << 10
            self.erased.append(FLASH + first)
            self.flash[first : first + size] = b"\xff" * size


class FakeMemory(MemoryInterface):  # type: ignore[misc]
    """The chip's memory, as a probe gives it to pyOCD."""

    def __init__(self, chip: FakeChip) -> None:
        self._chip = chip

    def write_memory(self, addr: int, data: int, transfer_size: int = 32, **_: Any) -> None:
        self._chip.write(addr, data.to_bytes(transfer_size // 8, "little"))

    def read_memory(self, addr: int, transfer_size: int = 32, now: bool = True, **_: Any) -> Any:
        value = int.from_bytes(self._chip.read(addr, transfer_size // 8), "little")
        return value if now else lambda: value

    def write_memory_block32(self, addr: int, data: Sequence[int], **_: Any) -> None:
        for i, word in enumerate(data):
            self.write_memory(addr + 4 * i, word)

    def read_memory_block32(self, addr: int, size: int, **_: Any) -> Sequence[int]:
        return [self.read_memory(addr + 4 * i) for i in range(size)]

    def write_memory_block8(self, addr: int, data: Sequence[int], **_: Any) -> None:
        self._chip.write(addr, bytes(data))

    def read_memory_block8(self, addr: int, size: int, **_: Any) -> Sequence[int]:
        return list(self._chip.read(addr, size))


class FakeProbe(DebugProbe):  # type: ignore[misc]
    """An ST-LINK that is always connected."""

    def __init__(self, chip: FakeChip, unique_id: str = "066DFF515049657187", name: str = "STM32 STLink") -> None:
        super().__init__()
        self.chip = chip
        self._id, self._name = unique_id, name
        self.held_in_reset = False  # ever
        self.is_responding = True
        self._open = self._in_reset = False
        self._dp: dict[int, int] = {}

    description = property(lambda self: self._name)
    vendor_name = property(lambda self: "STMicroelectronics")
    product_name = property(lambda self: self._name)
    unique_id = property(lambda self: self._id)
    supported_wire_protocols = property(lambda self: [DebugProbe.Protocol.DEFAULT, DebugProbe.Protocol.SWD])
    wire_protocol = property(lambda self: DebugProbe.Protocol.SWD)
    is_open = property(lambda self: self._open)
    capabilities = property(lambda self: {self.Capability.MANAGED_AP_SELECTION, self.Capability.MANAGED_DPBANKSEL})
    associated_board_info = None

    def create_associated_board(self) -> None:
        return None

    def open(self) -> None:
        self._open = True

    def close(self) -> None:
        self._open = False

    def connect(self, protocol: Any = None) -> None:
        pass

    def disconnect(self) -> None:
        pass

    def set_clock(self, frequency: float) -> None:
        pass

    def reset(self) -> None:
        self.chip.reset()

    def assert_reset(self, asserted: bool) -> None:
        self._in_reset = asserted
        self.held_in_reset |= asserted
        if not asserted:
            self.chip.reset()

    def is_reset_asserted(self) -> bool:
        return self._in_reset

    def flush(self) -> None:
        pass

    def read_dp(self, addr: int, now: bool = True) -> Any:
        if not self.is_responding:
            raise TransferError
        if addr == 0:
            value = 0x2BA0_1477
        else:
            request = self._dp.get(4, 0)
            value = request | (request >> 28 & 5) << 29 if addr == 4 else 0
        return value if now else lambda: value

    def write_dp(self, addr: int, data: int) -> None:
        self._dp[addr] = data

    def read_ap(self, addr: int, now: bool = True) -> Any:
        value = (
            {0xFC: 0x2477_0011, 0xF8: ROM_TABLE | 3, 0x00: 0x2300_0052}.get(addr & 0xFFFF, 0) if addr >> 24 == 0 else 0
        )
        return value if now else lambda: value

    def write_ap(self, addr: int, data: int) -> None:
        pass

    def get_memory_interface_for_ap(self, ap_address: Any) -> MemoryInterface:
        return FakeMemory(self.chip)
