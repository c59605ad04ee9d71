"""The emulated peripherals, register by register, against the reference manual (RM0090); the test is the program."""

import pytest

from firmware_stub.emulation.chip import Chip
from firmware_stub.emulation.nvic import FIRST_INTERRUPT, SYSTICK
from hil.common.errors import DeviceError
from tests.support.firmware.unicorn_program import GPIOA, IWDG, MS, RCC, TIM3, Program, program

__all__ = ["program"]  # the fixtures


SYSTICK_CSR, NVIC_ISER = 0xE000_E010, 0xE000_E100


def test_clocks_are_right_after_a_reset_and_at_full_speed(program: Program) -> None:
    rcc = program.chip.rcc
    assert (rcc.core_hz, rcc.apb1_hz, rcc.apb1_timer_hz, rcc.apb2_hz) == (16_000_000,) * 4
    program.full_speed()
    assert program.get(RCC) == 0x0303_0083, "an oscillator that is on is ready"
    assert program.get(RCC + 8) & 0xF == 0b1010, "the switch is acknowledged"
    assert (rcc.core_hz, rcc.apb1_hz, rcc.apb1_timer_hz) == (168_000_000, 42_000_000, 84_000_000)
    assert rcc.apb2_hz == 84_000_000
    program.put(RCC + 8, 9 << 4)
    assert rcc.core_hz == 4_000_000


def test_a_peripheral_without_its_clock_ignores_writes() -> None:
    chip = Chip(paced=False)
    chip.write(GPIOA + 0x14, 4, 5)
    assert chip.read(GPIOA + 0x14, 4) == 0
    chip.write(RCC + 0x30, 4, 1)
    chip.write(GPIOA + 0x14, 4, 5)
    assert chip.read(GPIOA + 0x14, 4) == 5


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


def test_systick_does_not_drift(program: Program) -> None:
    program.full_speed()
    start_systick(program, 1_000_003 - 1)  # 5.952398809... ms
    program.wait_until(100_000 * MS)
    assert program.chip.due_ns == -(-1_000_003 * 16800 * 1000 // 168)


def test_interrupts_are_taken_by_number_one_after_another(program: Program) -> None:
    nvic = program.chip.nvic
    program.put(NVIC_ISER + 4, 1 << 5)  # 37
    program.put(NVIC_ISER, 1 << 29 | 1 << 20)
    for interrupt in (29, 37, 20, 21):
        nvic.set_line(FIRST_INTERRUPT + interrupt, True)
    for interrupt in (20, 29, 37):
        assert nvic.enter() == FIRST_INTERRUPT + interrupt
        assert not nvic.urgent, "its handler runs"
        nvic.set_line(FIRST_INTERRUPT + interrupt, interrupt == 37)
        nvic.leave()
    assert program.is_pending(37), "a line that stays raised pends again"


def start_pwm(program: Program) -> None:
    for offset, value in ((0x28, 83), (0x2C, 19_999), (0x18, 0x6868), (0x20, 0x1111), (0x34, 1600), (0x00, 1)):
        program.put(TIM3 + offset, value)


def test_pulse_widths_follow_the_timer_registers(program: Program) -> None:
    program.full_speed()
    timer = program.chip.timers["TIM3"]
    assert timer.pulse_us(0) == 0
    start_pwm(program)
    assert [timer.pulse_us(i) for i in range(4)] == [1600, 0, 0, 0]
    program.put(TIM3 + 0x28, 41)
    assert timer.pulse_us(0) == 800, "half the prescaler"


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
    assert not chip.has_expired
    program.wait_until(chip.time.now_ns + 100 * MS - 1)
    assert not chip.has_expired
    program.wait_until(chip.time.now_ns + 1)
    assert chip.has_expired
    chip.reset()
    assert chip.due_ns > 1 << 62, "a reset stops the watchdog"
    assert program.get(RCC + 0x44) == 0
