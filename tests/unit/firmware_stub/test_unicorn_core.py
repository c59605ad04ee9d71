"""The emulated core: exceptions, masks, sleep and faults, by programs of a few instructions.

Each snippet is the machine code of the assembly beside it.
"""

import struct

import pytest

from firmware_stub.unicorn_board import UnicornBoard
from hil.common.errors import DeviceError

MS = 1_000_000
RAM, STACK_TOP, CODE = 0x2000_0000, 0x2002_0000, 0x0800_0400
SYSTICK = 15

thumb = bytes.fromhex
# r4: RAM, r5: the core's registers
SETUP = thumb("40f20004c2f200044ef20005cef20005")  # movw/movt r4,#0x20000000; movw/movt r5,#0xE000E000
# movw/movt r0,#0x20000000; ldr r1,[r0]; lsls r1,r1,#4; adds r1,#n; str r1,[r0]
NOTE_1 = thumb("40f20000c2f200000168090101310160")
NOTE_2 = thumb("40f20000c2f200000168090102310160")
NOTE_3 = thumb("40f20000c2f200000168090103310160")
RETURN = thumb("7047")  # bx lr
SPIN = thumb("fee7")  # b .
WFI = thumb("30bf")
CPSID, CPSIE = thumb("72b6"), thumb("62b600bf")  # cpsid i; cpsie i, nop
SYSTICK_1MS = thumb("43f67f60686107202861")  # movw r0,#15999; str r0,[r5,#0x14]; movs r0,#7; str r0,[r5,#0x10]
COUNT_WAKES = thumb("30bf606801306060fae7")  # 1: wfi; ldr r0,[r4,#4]; adds r0,#1; str r0,[r4,#4]; b 1b
PEND_SYSTICK = thumb("4ff08060c5f8040d")  # mov.w r0,#0x04000000; str.w r0,[r5,#0xD04]
MASK_AGAIN = thumb("012080f3108800bf")  # movs r0,#1; msr primask,r0; nop
START_IWDG = thumb("43f20001c4f200014cf6cc400860")  # movw/movt r1,#0x40003000; movw r0,#0xCCCC; str r0,[r1]
# Values into r0 to r3, r12, lr; flags by subtracting to -1 and adding 1; SysTick pended by str.w; all stored at [r4]
KEEP_REGISTERS = thumb(
    "0a200b210c220d234ff00e0c4ff00f0e4ff080670026013e16f10106c5f8047deff300880fc444f804cb44f804eb44f8048bc4f800d0"
)
# All those to 0, other flags; ipsr to 0x20000040, lr to 0x20000044; bx lr
CLOBBER_REGISTERS = thumb("00200021002200234ff0000c0128eff3058340f24002c2f200021360c2f804e07047")
SUB_SP_4 = thumb("81b0")
# movs r1,#0; cmp r1,#0; ittt eq; streq.w (pends SysTick); addeq r1,#1; addeq r1,#1; adds r1,#1; str r1,[r4,#8]
PEND_IN_IT_BLOCK = thumb("4ff080600021002902bfc5f8040d013101310131a160")


def board(main: bytes, systick: bytes = b"") -> UnicornBoard:
    """Return a board with that program, and the handler of SysTick's exception."""
    table = [STACK_TOP] + [CODE | 1] * 97
    code = (main + SPIN).ljust(0x100, b"\0")
    table[SYSTICK] = (CODE + len(code)) | 1
    code += systick
    return UnicornBoard(struct.pack("<98I", *table).ljust(CODE - 0x0800_0000, b"\0") + code)


def read_words(board: UnicornBoard, address: int, count: int) -> tuple[int, ...]:
    return struct.unpack(f"<{count}I", board.read_memory(address, 4 * count))


def trace(board: UnicornBoard) -> int:
    """Return the recorded marks as a number, a hexadecimal digit each."""
    return read_words(board, RAM, 1)[0]


def test_systick_wakes_a_sleeping_core_every_millisecond() -> None:
    sleeper = board(SETUP + SYSTICK_1MS + COUNT_WAKES, systick=NOTE_1 + RETURN)
    for end_ns, wakes in ((MS - 1, 0), (MS, 1), (10 * MS + 1, 10), (1000 * MS, 1000)):
        sleeper.run_until(end_ns)
        assert read_words(sleeper, RAM + 4, 1) == (wakes,)
    assert sleeper.now_ns == 1000 * MS


@pytest.mark.parametrize(
    ("main", "order"),
    [
        (PEND_SYSTICK + NOTE_3, 0x23),  # at once
        (CPSID + PEND_SYSTICK + NOTE_1 + CPSIE + NOTE_3, 0x123),
        (CPSID + PEND_SYSTICK + MASK_AGAIN + NOTE_1, 0x1),
    ],
)
def test_masks_hold_an_exception_pending_until_cleared(main: bytes, order: int) -> None:
    assert trace(board(SETUP + main, systick=NOTE_2 + RETURN)) == order


@pytest.mark.parametrize(
    ("awake", "order"), [(NOTE_1 + CPSIE + NOTE_3, 0x123), (CPSIE + NOTE_1 + NOTE_3, 0x213), (NOTE_1 + NOTE_3, 0x13)]
)
def test_a_masked_exception_wakes_the_core_but_stays_pending(awake: bytes, order: int) -> None:
    masked = board(SETUP + SYSTICK_1MS + CPSID + WFI + awake, systick=NOTE_2 + RETURN)
    assert trace(masked) == 0
    masked.run_until(MS)
    assert trace(masked) == order


@pytest.mark.parametrize(("before", "stack"), [(b"", STACK_TOP), (SUB_SP_4, STACK_TOP - 4)])
def test_an_exception_preserves_the_interrupted_programs_registers(before: bytes, stack: int) -> None:
    interrupted = board(SETUP + before + KEEP_REGISTERS, systick=CLOBBER_REGISTERS)
    *registers, flags, sp = read_words(interrupted, RAM, 8)
    assert registers == [10, 11, 12, 13, 14, 15]
    assert flags & 0xF000_0000 == 0x6000_0000, "zero and carry"
    assert sp == stack
    assert read_words(interrupted, RAM + 0x40, 2) == (SYSTICK, 0xFFFF_FFF9)


def test_an_exception_in_an_it_block_skips_and_repeats_nothing() -> None:
    conditional = board(SETUP + PEND_IN_IT_BLOCK + WFI, systick=NOTE_2 + RETURN)
    conditional.run_until(2 * MS)
    assert read_words(conditional, RAM + 8, 1) == (3,)
    assert trace(conditional) == 2


def test_time_advances_in_a_program_that_never_sleeps() -> None:
    busy = board(SETUP + START_IWDG)
    busy.run_until(511 * MS)
    assert busy.resets == 0
    busy.run_until(512 * MS)  # 4096 x 4 / 32 kHz
    assert (busy.resets, busy.now_ns) == (1, 512 * MS)


FAULTS = {
    "4ff0c0404168": ("read 4 bytes at 0x60000004", "pc 0x08000414"),  # mov.w r0,#0x60000000; ldr r1,[r0,#4]
    "4ff000600060": ("wrote 4 bytes (0x8000000) at 0x08000000", "pc 0x08000414"),  # str r0,[0x08000000]
    "40f20100c6f200000047": ("executed", "at 0x60000000", "pc 0x60000000"),  # bx to 0x60000001
    "00de": ("executed an invalid instruction", "pc 0x08000410"),  # udf
    "00be": ("executed a breakpoint", "pc 0x08000410"),  # bkpt
    "47f60000c4f200008168": ("read 4 bytes: no register is at 0x40007808", "pc 0x08000418"),  # ldr
    "47f60000c4f200008160": ("wrote 0x0: no register is at 0x40007808", "pc 0x08000418"),  # str
    "c5f80c0d": ("the register at 0xe000ed0c is not modelled",),  # str.w r0,[r5,#0xD0C]
    # mov sp,#0x20000000; pend SysTick
    "40f20000c2f2000085464ff08060c5f8040d": ("has no memory at 0x1fffffe0", "sp 0x20000000", "lr 0xffffffff"),
}


@pytest.mark.parametrize("code", FAULTS)
def test_a_fault_is_reported_with_its_kind_and_address(code: str) -> None:
    with pytest.raises(DeviceError) as caught:
        board(SETUP + thumb(code), systick=RETURN)
    message = str(caught.value)
    assert message.startswith("the emulated STM32 ")
    assert all(part in message for part in FAULTS[code]), message
    assert "\n" not in message
