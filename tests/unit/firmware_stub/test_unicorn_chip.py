"""The emulated peripherals, register by register, against the reference manual (RM0090); the test is the program."""

import pytest

from firmware_stub.emulation.chip import Chip
from firmware_stub.emulation.nvic import FIRST_INTERRUPT, SYSTICK
from firmware_stub.emulation.rcc import WATCHDOG_RESET
from hil.common.errors import DeviceError
from tests.support.firmware.unicorn_program import (
    GPIOA,
    IWDG,
    MS,
    RCC,
    TIM1,
    TIM3,
    TIM3_IRQ,
    Program,
    program,
)

__all__ = ["program"]  # the fixtures


SYSTICK_CSR, NVIC_ISER, NVIC_ICPR, NVIC_IABR, NVIC_IPR, ICSR = (
    0xE000_E000 + offset for offset in (0x10, 0x100, 0x280, 0x300, 0x400, 0xD04)
)


def test_clocks_are_right_after_a_reset_and_at_full_speed(program: Program) -> None:
    rcc = program.chip.rcc
    assert (rcc.core_hz, rcc.apb1_hz, rcc.apb1_timer_hz, rcc.apb2_hz) == (16_000_000,) * 4
    program.full_speed()
    assert program.get(RCC) == 0x0303_0083, "an oscillator that is on is ready"
    assert program.get(RCC + 8) & 0xF == 0b1010, "the switch is acknowledged"
    assert (rcc.core_hz, rcc.apb1_hz, rcc.apb1_timer_hz) == (168_000_000, 42_000_000, 84_000_000)
    assert (rcc.apb2_hz, rcc.apb2_timer_hz) == (84_000_000, 168_000_000)
    program.put(RCC + 8, 9 << 4)
    assert rcc.core_hz == 4_000_000


def test_a_peripheral_without_its_clock_ignores_writes() -> None:
    chip = Chip(paced=False)
    chip.write(GPIOA + 0x14, 4, 5)
    assert chip.read(GPIOA + 0x14, 4) == 0
    chip.write(RCC + 0x30, 4, 1)
    chip.write(GPIOA + 0x14, 4, 5)
    assert chip.read(GPIOA + 0x14, 4) == 5
    chip.write(RCC + 0x10, 4, 1)  # reset of port A
    assert chip.read(GPIOA + 0x14, 4) == 0


def test_registers_can_be_accessed_by_byte_and_halfword(program: Program) -> None:
    program.put(GPIOA + 0x14, 0x1122_3344)
    program.put(GPIOA + 0x15, 0xAA, size=1)
    program.put(GPIOA + 0x16, 0xBBCC, size=2)
    assert program.get(GPIOA + 0x14) == 0xBBCC_AA44
    assert (program.get(GPIOA + 0x15, 1), program.get(GPIOA + 0x16, 2)) == (0xAA, 0xBBCC)


@pytest.mark.parametrize("address", [0x4000_7800, 0x4007_0000])
def test_access_to_a_register_that_does_not_exist_is_reported(program: Program, address: int) -> None:
    with pytest.raises(DeviceError, match=f"no register is at 0x{address:08x}"):
        program.get(address)
    with pytest.raises(DeviceError, match=f"no register is at 0x{address:08x}"):
        program.put(address, 1)


def start_systick(program: Program, reload: int, csr: int = 7) -> None:
    program.put(SYSTICK_CSR + 4, reload)
    program.put(SYSTICK_CSR + 8, 0)
    program.put(SYSTICK_CSR, csr)


def test_systick_counts_down_and_raises_its_exception(program: Program) -> None:
    program.full_speed()
    start_systick(program, 168_000 - 1)
    program.wait_until(MS - 1)
    assert not program.chip.nvic.pending >> SYSTICK & 1
    assert program.get(SYSTICK_CSR + 8) == 0
    program.wait_until(MS + 500)
    assert program.chip.nvic.pending >> SYSTICK & 1
    assert program.get(SYSTICK_CSR + 8) == 168_000 - 1 - 84
    assert program.get(SYSTICK_CSR) == 0x1_0007, "it counted to zero"
    assert program.get(SYSTICK_CSR) == 7, "reading the flag clears it"


def test_systick_does_not_drift(program: Program) -> None:
    program.full_speed()
    start_systick(program, 1_000_003 - 1)  # 5.952398809... ms
    program.wait_until(100_000 * MS)
    assert program.chip.due_ns == -(-1_000_003 * 16800 * 1000 // 168)


def test_a_clock_change_scales_the_remaining_count(program: Program) -> None:
    start_systick(program, 16_000 - 1)
    program.wait_until(MS // 2)
    program.full_speed()
    assert program.get(SYSTICK_CSR + 8) == 7999
    assert program.chip.due_ns == MS // 2 + -(-8000 * 1000 // 168)


def test_interrupts_are_enabled_prioritised_and_shown_in_registers(program: Program) -> None:
    nvic = program.chip.nvic
    program.put(NVIC_ISER + 4, 1 << 5)  # 37
    program.put(NVIC_ISER, 1 << 29 | 1 << 20)
    assert program.get(NVIC_ISER) == 1 << 29 | 1 << 20
    program.put(NVIC_IPR + 37, 0x40, size=1)
    program.put(NVIC_IPR + 29, 0x8F, size=1)  # the four lower bits do not exist
    program.put(NVIC_IPR + 20, 0x40, size=1)
    assert program.get(NVIC_IPR + 29, 1) == 0x80
    for interrupt in (29, 37, 20):
        nvic.set_line(FIRST_INTERRUPT + interrupt, True)
    assert [nvic.enter() - FIRST_INTERRUPT for _ in range(3)] == [20, 37, 29], "by priority, then by number"
    assert program.get(NVIC_IABR + 4) == 1 << 5
    assert program.get(ICSR) & 0x1FF == FIRST_INTERRUPT + 29
    nvic.leave()
    assert program.is_pending(29), "a line that stays raised pends again"
    nvic.set_line(FIRST_INTERRUPT + 29, False)
    program.put(NVIC_ICPR, 1 << 29)
    assert not program.is_pending(29)


def start_pwm(program: Program, timer: int = TIM3) -> None:
    for offset, value in ((0x28, 83), (0x2C, 19_999), (0x18, 0x6868), (0x20, 0x1111), (0x34, 1600), (0x00, 1)):
        program.put(timer + offset, value)


def test_pulse_widths_follow_the_timer_registers(program: Program) -> None:
    program.full_speed()
    timer = program.chip.timers["TIM3"]
    assert timer.pulse_us(0) == 0
    start_pwm(program)
    assert [timer.pulse_us(i) for i in range(4)] == [1600, 0, 0, 0]
    program.put(TIM3 + 0x28, 41)
    assert timer.pulse_us(0) == 800, "half the prescaler"
    program.put(TIM3 + 0x18, 0x78)  # mode 2: low for the compare value
    assert timer.pulse_us(0) == (20_000 - 1600) // 2


@pytest.mark.parametrize(
    ("offset", "value", "reason"),
    [
        (0x00, 0, "the counter stands"),
        (0x20, 0x1110, "the output is off"),
        (0x18, 0x6801, "an input"),
        (0x18, 0x6858, "forced to a level"),
        (0x34, 20_000, "always high"),
        (0x34, 0, "always low"),
    ],
)
def test_disabled_timers_give_no_pulses(program: Program, offset: int, value: int, reason: str) -> None:
    start_pwm(program)
    assert program.chip.timers["TIM3"].pulse_us(0) > 0
    program.put(TIM3 + offset, value)
    assert program.chip.timers["TIM3"].pulse_us(0) == 0, reason


def test_an_advanced_timer_needs_main_output_enable(program: Program) -> None:
    program.full_speed()
    start_pwm(program, TIM1)
    assert program.chip.timers["TIM1"].pulse_us(0) == 0
    program.put(TIM1 + 0x44, 1 << 15)
    assert program.chip.timers["TIM1"].pulse_us(0) == 800, "it is fed with 168 MHz"


def test_a_timer_counts_sets_its_flag_and_raises_its_interrupt(program: Program) -> None:
    program.full_speed()
    start_pwm(program)  # 1 MHz, 20 ms
    program.wait_until(5_000_500)
    assert program.get(TIM3 + 0x24) == 5000
    program.wait_until(20 * MS)
    assert (program.get(TIM3 + 0x24), program.get(TIM3 + 0x10)) == (0, 1)
    assert not program.is_pending(TIM3_IRQ)
    program.put(TIM3 + 0x10, 0)
    program.put(TIM3 + 0x0C, 1)
    program.wait_until(40 * MS - 1)
    assert not program.is_pending(TIM3_IRQ)
    program.wait_until(40 * MS)
    assert program.is_pending(TIM3_IRQ)
    program.put(TIM3 + 0x14, 1)
    assert program.get(TIM3 + 0x24) == 0


def test_the_watchdog_needs_its_keys_and_resets_the_chip(program: Program) -> None:
    chip = program.chip
    program.put(IWDG + 8, 100)
    assert program.get(IWDG + 8) == 0xFFF, "locked"
    program.put(IWDG, 0x5555)
    program.put(IWDG + 4, 3)  # 1 kHz
    program.put(IWDG + 8, 99)
    program.put(IWDG, 0xCCCC)
    for _ in range(5):
        program.wait_until(chip.time.now_ns + 99 * MS)
        program.put(IWDG, 0xAAAA)
    assert chip.reset_by == 0
    program.wait_until(chip.time.now_ns + 100 * MS - 1)
    assert chip.reset_by == 0
    program.wait_until(chip.time.now_ns + 1)
    assert chip.reset_by == WATCHDOG_RESET
    chip.reset()
    assert program.get(RCC + 0x74) >> 29 & 1, "the reset cause is in a register"
    assert chip.due_ns > 1 << 62, "a reset stops the watchdog"
    assert program.get(RCC + 0x44) == 0
