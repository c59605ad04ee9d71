"""The emulated core: exceptions, masks, sleep and faults, by programs of a few instructions.

Each snippet is the machine code of the assembly beside it.
"""

import struct

import pytest

from firmware_stub.unicorn_board import UnicornBoard
from hil.common.errors import DeviceError

MS = 1_000_000
RAM, STACK_TOP, CODE = 0x2000_0000, 0x2002_0000, 0x0800_0400
SVCALL, PENDSV, SYSTICK = 11, 14, 15

thumb = bytes.fromhex
# r4: RAM, r5: the core's registers
SETUP = thumb("40f20004c2f200044ef20005cef20005")  # movw/movt r4,#0x20000000; movw/movt r5,#0xE000E000
# movw/movt r0,#0x20000000; ldr r1,[r0]; lsls r1,r1,#4; adds r1,#n; str r1,[r0]
NOTE_1 = thumb("40f20000c2f200000168090101310160")
NOTE_2 = thumb("40f20000c2f200000168090102310160")
NOTE_3 = thumb("40f20000c2f200000168090103310160")
RETURN = thumb("7047")  # bx lr
SPIN = thumb("fee7")  # b .
WFI, WFE = thumb("30bf"), thumb("20bf")
CPSID, CPSIE = thumb("72b6"), thumb("62b600bf")  # cpsid i; cpsie i, nop
SYSTICK_1MS = thumb("43f67f60686107202861")  # movw r0,#15999; str r0,[r5,#0x14]; movs r0,#7; str r0,[r5,#0x10]
COUNT_WAKES = thumb("30bf606801306060fae7")  # 1: wfi; ldr r0,[r4,#4]; adds r0,#1; str r0,[r4,#4]; b 1b
PEND_SYSTICK = thumb("4ff08060c5f8040d")  # mov.w r0,#0x04000000; str.w r0,[r5,#0xD04]
# mov.w r0,#0x10000000; movw/movt r1,#0xE000E000; str.w r0,[r1,#0xD04]
PEND_PENDSV = thumb("4ff080504ef20001cef20001c1f8040d")
SYSTICK_LAST = thumb("f02085f8230d")  # movs r0,#0xF0; strb.w r0,[r5,#0xD23]
PENDSV_LAST = thumb("f02085f8220d")  # movs r0,#0xF0; strb.w r0,[r5,#0xD22]
SYSTICK_20 = thumb("202085f8230d")  # movs r0,#0x20; strb.w r0,[r5,#0xD23]
BASEPRI_10 = thumb("102080f3118800bf")  # movs r0,#0x10; msr basepri,r0; nop
BASEPRI_0 = thumb("002080f3118800bf")  # movs r0,#0; msr basepri,r0; nop
MASK_AGAIN = thumb("012080f3108800bf")  # movs r0,#1; msr primask,r0; nop
SLEEP_ON_EXIT = thumb("0220c5f8100d")  # movs r0,#2; str.w r0,[r5,#0xD10]
ASK_FOR_RESET = thumb("40f20400c0f2fa50c5f80c0dfee7")  # movw/movt r0,#0x05FA0004; str.w r0,[r5,#0xD0C]; b .
COUNT_BOOTS = thumb("606801306060032803d0")  # ldr r0,[r4,#4]; adds r0,#1; str r0,[r4,#4]; cmp r0,#3; beq .+10
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
SVC_5 = thumb("012005dfe060")  # movs r0,#1; svc #5; str r0,[r4,#12]
# the stack it came from; ldr pc; ldrb r0,[r0,#-2]: the number; adds r0,#100; into the saved r0; lr to 0x20000010
ANSWER_SVC = thumb("eff30982eff308811ef0040f14bf13460b46986910f8020c6430186040f20001c2f20001c1f810e07047")
USE_PROCESS_STACK = thumb("41f20000c2f2000080f30988022080f31488bff36f8f")  # msr psp,#0x20001000; msr control,#2; isb
# 7 into s0 and s15; pend SysTick; s0, s15 and sp to [r4,#4]
KEEP_FLOATS = thumb("072000ee100a07ee900a0aee100a4ff08067c5f8047d10ee100a17ee901a6060a160c4f80cd0")
CLOBBER_FLOATS = thumb("092000ee100a07ee900a40f24000c2f20000c0f800e0c0f804d07047")  # 9; lr, sp to 0x20000040


def board(main: bytes, **handlers: bytes) -> UnicornBoard:
    """Return a board with that program; handlers are named svcall, pendsv, systick."""
    table = [STACK_TOP] + [CODE | 1] * 97
    code = (main + SPIN).ljust(0x100, b"\0")
    for name, handler in handlers.items():
        table[{"svcall": SVCALL, "pendsv": PENDSV, "systick": SYSTICK}[name]] = (CODE + len(code)) | 1
        code += handler.ljust(0x80, b"\0")
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
        (SYSTICK_20 + BASEPRI_10 + PEND_SYSTICK + NOTE_1 + BASEPRI_0 + NOTE_3, 0x123),
        (BASEPRI_10 + PEND_SYSTICK + NOTE_3, 0x23),  # priority 0 passes
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


@pytest.mark.parametrize(("priority", "order"), [(SYSTICK_LAST, 0x1232), (SYSTICK_LAST + PENDSV_LAST, 0x1223)])
def test_a_higher_priority_exception_preempts_and_an_equal_one_waits(priority: bytes, order: int) -> None:
    nested = board(
        SETUP + priority + NOTE_1 + PEND_SYSTICK, systick=NOTE_2 + PEND_PENDSV + NOTE_2 + RETURN, pendsv=NOTE_3 + RETURN
    )
    assert trace(nested) == order


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


@pytest.mark.parametrize(("before", "returns_with"), [(b"", 0xFFFF_FFF9), (USE_PROCESS_STACK, 0xFFFF_FFFD)])
def test_a_supervisor_call_uses_the_callers_stack(before: bytes, returns_with: int) -> None:
    caller = board(SETUP + before + SVC_5, svcall=ANSWER_SVC)
    assert read_words(caller, RAM + 12, 2) == (105, returns_with)


def test_float_registers_survive_a_handler_that_uses_them() -> None:
    interrupted = board(SETUP + KEEP_FLOATS, systick=CLOBBER_FLOATS)
    assert read_words(interrupted, RAM + 4, 3) == (7, 7, STACK_TOP)
    assert read_words(interrupted, RAM + 0x40, 2) == (0xFFFF_FFE9, STACK_TOP - 0x68)


def test_sleep_on_exit_does_not_return_to_the_program() -> None:
    handler_only = board(SETUP + SYSTICK_1MS + SLEEP_ON_EXIT + WFI + NOTE_3, systick=NOTE_1 + RETURN)
    handler_only.run_until(5 * MS)
    assert trace(handler_only) == 0x11111


def test_a_wait_for_an_event_ends_with_the_next_exception() -> None:
    waiting = board(SETUP + SYSTICK_1MS + WFE + NOTE_1 + WFE + WFE + NOTE_3, systick=NOTE_2 + RETURN)
    assert trace(waiting) == 0
    waiting.run_until(MS)
    assert trace(waiting) == 0x21, "the exception's return is the event of the second wait"
    waiting.run_until(2 * MS)
    assert trace(waiting) == 0x2123


def test_a_program_can_reset_itself() -> None:
    restarted = board(SETUP + COUNT_BOOTS + ASK_FOR_RESET)
    restarted.run_until(10 * MS)
    assert read_words(restarted, RAM + 4, 1) == (3,)
    assert restarted.resets == 0, "only the watchdog's are counted"
    restarted.reset()
    assert read_words(restarted, RAM + 4, 1) == (4,), "RAM keeps its content"


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
