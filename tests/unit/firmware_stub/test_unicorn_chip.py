"""The emulated peripherals, register by register, against the reference manual (RM0090). The test is the program."""

import pytest

from firmware_stub.emulation.chip import PLACES, Chip
from firmware_stub.emulation.nvic import FIRST_INTERRUPT, SYSTICK
from firmware_stub.emulation.rcc import WATCHDOG_RESET
from hil.common.errors import DeviceError
from hil.links.wires.can_frame import CanFrame

MS = 1_000_000
RCC, USART1, TIM3, TIM1, IWDG, CAN1, GPIOA = (
    PLACES[name].address for name in ("RCC", "USART1", "TIM3", "TIM1", "IWDG", "CAN1", "GPIOA")
)
SYSTICK_CSR, NVIC_ISER, NVIC_ICPR, NVIC_IABR, NVIC_IPR, ICSR = (
    0xE000_E000 + offset for offset in (0x10, 0x100, 0x280, 0x300, 0x400, 0xD04)
)
USART1_IRQ, TIM3_IRQ, CAN1_TX_IRQ, CAN1_RX0_IRQ, CAN1_RX1_IRQ = 37, 29, 19, 20, 21


class Program:
    """A chip with everything switched on, and what a program does to it."""

    def __init__(self, paced: bool = False) -> None:
        self.chip = Chip(paced)
        for register in (0x30, 0x40, 0x44):
            self.put(RCC + register, 0xFFFF_FFFF)

    def put(self, address: int, value: int, size: int = 4) -> None:
        self.chip.write(address, size, value)

    def get(self, address: int, size: int = 4) -> int:
        return self.chip.read(address, size)

    def wait_until(self, end_ns: int) -> None:
        chip = self.chip
        while chip.due_ns <= end_ns:
            chip.time.now_ns = chip.due_ns
            chip.tick()
        chip.time.now_ns = end_ns

    def asked_for(self, interrupt: int) -> bool:
        return bool(self.chip.nvic.pending >> FIRST_INTERRUPT + interrupt & 1)

    def full_speed(self) -> None:
        """168 MHz from the crystal: APB1 42 MHz, APB2 84 MHz."""
        self.put(RCC, 0x0101_0083)
        self.put(RCC + 4, 7 << 24 | 1 << 22 | 336 << 6 | 8)
        self.put(RCC + 8, 4 << 13 | 5 << 10 | 2)


@pytest.fixture
def program() -> Program:
    return Program()


# ---- clocks


def test_clocks_after_a_reset_and_at_full_speed(program: Program) -> None:
    rcc = program.chip.rcc
    assert (rcc.core_hz, rcc.apb1_hz, rcc.apb1_timer_hz, rcc.apb2_hz) == (16_000_000,) * 4
    program.full_speed()
    assert program.get(RCC) == 0x0303_0083, "an oscillator that is on is ready"
    assert program.get(RCC + 8) & 0xF == 0b1010, "the switch is acknowledged"
    assert (rcc.core_hz, rcc.apb1_hz, rcc.apb1_timer_hz) == (168_000_000, 42_000_000, 84_000_000)
    assert (rcc.apb2_hz, rcc.apb2_timer_hz) == (84_000_000, 168_000_000)
    program.put(RCC + 8, 9 << 4)
    assert rcc.core_hz == 4_000_000


def test_a_peripheral_without_its_clock_is_dead() -> None:
    chip = Chip(paced=False)
    chip.write(GPIOA + 0x14, 4, 5)
    assert chip.read(GPIOA + 0x14, 4) == 0
    chip.write(RCC + 0x30, 4, 1)
    chip.write(GPIOA + 0x14, 4, 5)
    assert chip.read(GPIOA + 0x14, 4) == 5
    chip.write(RCC + 0x10, 4, 1)  # reset of port A
    assert chip.read(GPIOA + 0x14, 4) == 0


def test_bytes_and_halfwords_of_a_register(program: Program) -> None:
    program.put(GPIOA + 0x14, 0x1122_3344)
    program.put(GPIOA + 0x15, 0xAA, size=1)
    program.put(GPIOA + 0x16, 0xBBCC, size=2)
    assert program.get(GPIOA + 0x14) == 0xBBCC_AA44
    assert (program.get(GPIOA + 0x15, 1), program.get(GPIOA + 0x16, 2)) == (0xAA, 0xBBCC)


@pytest.mark.parametrize("address", [0x4000_7800, 0x4007_0000])
def test_a_register_that_does_not_exist_is_named(program: Program, address: int) -> None:
    with pytest.raises(DeviceError, match=f"no register is at 0x{address:08x}"):
        program.get(address)
    with pytest.raises(DeviceError, match=f"no register is at 0x{address:08x}"):
        program.put(address, 1)


# ---- the core's registers


def start_systick(program: Program, reload: int, csr: int = 7) -> None:
    program.put(SYSTICK_CSR + 4, reload)
    program.put(SYSTICK_CSR + 8, 0)
    program.put(SYSTICK_CSR, csr)


def test_systick_counts_down_and_asks_each_time(program: Program) -> None:
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


def test_a_change_of_clock_changes_what_is_left_to_count(program: Program) -> None:
    start_systick(program, 16_000 - 1)
    program.wait_until(MS // 2)
    program.full_speed()
    assert program.get(SYSTICK_CSR + 8) == 7999
    assert program.chip.due_ns == MS // 2 + -(-8000 * 1000 // 168)


def test_interrupts_are_enabled_chosen_and_shown(program: Program) -> None:
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
    assert program.asked_for(29), "a line that stays raised asks again"
    nvic.set_line(FIRST_INTERRUPT + 29, False)
    program.put(NVIC_ICPR, 1 << 29)
    assert not program.asked_for(29)


# ---- timers


def start_pwm(program: Program, timer: int = TIM3) -> None:
    for offset, value in ((0x28, 83), (0x2C, 19_999), (0x18, 0x6868), (0x20, 0x1111), (0x34, 1600), (0x00, 1)):
        program.put(timer + offset, value)


def test_pulses_are_what_the_registers_say(program: Program) -> None:
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
    ("offset", "value", "why"),
    [
        (0x00, 0, "the counter stands"),
        (0x20, 0x1110, "the output is off"),
        (0x18, 0x6801, "an input"),
        (0x18, 0x6858, "forced to a level"),
        (0x34, 20_000, "always high"),
        (0x34, 0, "always low"),
    ],
)
def test_no_pulses(program: Program, offset: int, value: int, why: str) -> None:
    start_pwm(program)
    assert program.chip.timers["TIM3"].pulse_us(0) > 0
    program.put(TIM3 + offset, value)
    assert program.chip.timers["TIM3"].pulse_us(0) == 0, why


def test_an_advanced_timer_has_a_main_switch(program: Program) -> None:
    program.full_speed()
    start_pwm(program, TIM1)
    assert program.chip.timers["TIM1"].pulse_us(0) == 0
    program.put(TIM1 + 0x44, 1 << 15)
    assert program.chip.timers["TIM1"].pulse_us(0) == 800, "it is fed with 168 MHz"


def test_a_timer_counts_flags_and_asks(program: Program) -> None:
    program.full_speed()
    start_pwm(program)  # 1 MHz, 20 ms
    program.wait_until(5_000_500)
    assert program.get(TIM3 + 0x24) == 5000
    program.wait_until(20 * MS)
    assert (program.get(TIM3 + 0x24), program.get(TIM3 + 0x10)) == (0, 1)
    assert not program.asked_for(TIM3_IRQ)
    program.put(TIM3 + 0x10, 0)
    program.put(TIM3 + 0x0C, 1)
    program.wait_until(40 * MS - 1)
    assert not program.asked_for(TIM3_IRQ)
    program.wait_until(40 * MS)
    assert program.asked_for(TIM3_IRQ)
    program.put(TIM3 + 0x14, 1)
    assert program.get(TIM3 + 0x24) == 0


# ---- watchdog


def test_the_watchdog_needs_its_keys_and_ends_in_a_reset(program: Program) -> None:
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
    assert program.get(RCC + 0x74) >> 29 & 1, "the program can see why it starts"
    assert chip.due_ns > 1 << 62, "a reset stops the watchdog"
    assert program.get(RCC + 0x44) == 0


# ---- serial port


def open_usart(program: Program, interrupts: int = 1 << 5) -> None:
    program.full_speed()
    program.put(USART1 + 8, 729)  # 84 MHz / 729 = 115226 bit/s
    program.put(USART1 + 0xC, 1 << 13 | 1 << 3 | 1 << 2 | interrupts)


def test_bytes_wait_for_the_program_that_reads_them(program: Program) -> None:
    port = program.chip.usarts["USART1"]
    open_usart(program)
    port.receive(bytes(range(20)))
    received = b""
    for group in (16, 4):
        assert port.deliver()
        assert program.asked_for(USART1_IRQ)
        while program.get(USART1) & 1 << 5:
            received += bytes([program.get(USART1 + 4)])
        assert len(received) % 16 == group % 16
    assert received == bytes(range(20))
    assert program.get(USART1) & 1 << 4, "the line is idle"
    assert not port.deliver()


def test_a_byte_that_nobody_reads_is_overrun(program: Program) -> None:
    port = program.chip.usarts["USART1"]
    open_usart(program)
    port.receive(b"ab")
    port.deliver()
    port.deliver()
    assert program.get(USART1) & 0x28 == 0x28
    assert program.get(USART1 + 4) == ord("a")
    assert program.get(USART1) & 0x28 == 0, "reading status, then data, clears the overrun"
    assert port.lost == 1


def test_a_port_that_is_off_hears_and_says_nothing(program: Program) -> None:
    port = program.chip.usarts["USART1"]
    program.put(USART1 + 4, ord("x"))
    port.receive(b"abc")
    while port.deliver():
        pass
    assert (port.take_output(), port.lost, program.get(USART1) & 1 << 5) == (b"", 3, 0)


def test_sending_asks_for_more(program: Program) -> None:
    open_usart(program, interrupts=1 << 7)
    assert program.asked_for(USART1_IRQ)
    program.put(USART1 + 4, ord("o"), size=1)
    program.put(USART1 + 4, ord("k"), size=2)
    assert program.chip.usarts["USART1"].take_output() == b"ok"


@pytest.mark.parametrize(("cr1", "cr2", "bits"), [(0, 0, 10), (1 << 12, 0, 11), (0, 2 << 12, 11)])
def test_paced_bytes_take_their_time_both_ways(cr1: int, cr2: int, bits: int) -> None:
    program = Program(paced=True)
    port = program.chip.usarts["USART1"]
    open_usart(program, cr1)
    program.put(USART1 + 0x10, cr2)
    byte_ns = bits * 729 * 1000 // 84
    port.receive(b"abc")
    program.put(USART1 + 4, ord("x"))
    assert program.get(USART1) & 0xC0 == 0x80, "the first one is on its way, there is room for another"
    program.put(USART1 + 4, ord("y"))
    assert program.get(USART1) & 0xC0 == 0
    program.wait_until(byte_ns - 1)
    assert (port.take_output(), program.get(USART1) & 0x20) == (b"", 0)
    program.wait_until(byte_ns)
    assert (port.take_output(), program.get(USART1 + 4)) == (b"x", ord("a"))
    program.wait_until(2 * byte_ns)
    assert (port.take_output(), program.get(USART1 + 4), program.get(USART1) & 0xC0) == (b"y", ord("b"), 0xC0)
    program.wait_until(4 * byte_ns - 1)
    assert (program.get(USART1 + 4), program.get(USART1) & 0x10) == (ord("c"), 0)
    program.wait_until(4 * byte_ns)
    assert program.get(USART1) & 0x10, "idle, one byte's time after the last"


def test_a_paced_byte_too_late_to_be_read_is_lost() -> None:
    program = Program(paced=True)
    open_usart(program)
    program.chip.usarts["USART1"].receive(b"abc")
    program.wait_until(MS)
    assert program.get(USART1) & 0x28 == 0x28
    assert (program.get(USART1 + 4), program.chip.usarts["USART1"].lost) == (ord("a"), 2)


# ---- CAN


def open_can(program: Program, scale: int, mode: int, first: int, second: int = 0, fifo: int = 0, btr: int = 0) -> None:
    """Initialise with one filter, in bank 3."""
    program.put(CAN1, 1)
    assert program.get(CAN1 + 4) & 3 == 1, "initialisation is acknowledged"
    program.put(CAN1 + 0x1C, 0x1C_0003 | btr)
    program.put(CAN1 + 0x200, 0x2A1C_0E01)
    for offset, bit in ((0x204, mode), (0x20C, scale), (0x214, fifo), (0x21C, 1)):
        program.put(CAN1 + offset, bit << 3)
    program.put(CAN1 + 0x240 + 24, first)
    program.put(CAN1 + 0x244 + 24, second)
    program.put(CAN1 + 0x200, 0x2A1C_0E00)
    program.put(CAN1 + 0x14, 0b010011)
    program.put(CAN1, 0)
    assert program.get(CAN1 + 4) & 3 == 0


def read_fifo(program: Program, fifo: int = 0) -> list[CanFrame]:
    """Empty it as a program does."""
    frames = []
    base = CAN1 + 0x1B0 + 0x10 * fifo
    while program.get(CAN1 + 0x0C + 4 * fifo) & 3:
        marked, size, low, high = (program.get(base + place) for place in (0, 4, 8, 12))
        extended = bool(marked & 4)
        data = (low | high << 32).to_bytes(8, "little")[: size & 15]
        frames.append(CanFrame(marked >> 3 if extended else marked >> 21, data, extended))
        program.put(CAN1 + 0x0C + 4 * fifo, 1 << 5)
    return frames


EXTENDED, STANDARD = CanFrame(0x1234_5678, b"12345678"), CanFrame(0x123, b"ab", extended=False)


def test_frames_come_in_through_the_fifo_and_none_is_lost(program: Program) -> None:
    open_can(program, scale=1, mode=0, first=0)
    frames = [CanFrame(i, bytes([i])) for i in range(10)] + [STANDARD]
    program.chip.can.receive(frames)
    program.chip.can.deliver()
    assert program.asked_for(CAN1_RX0_IRQ)
    assert program.get(CAN1 + 0x0C) & 0x1B == 0b01011, "three in it: full"
    assert read_fifo(program) == frames


@pytest.mark.parametrize(
    ("scale", "mode", "first", "second", "let_in"),
    [
        (1, 0, 0, 0, [EXTENDED, STANDARD]),
        (1, 0, 0x1234_5678 << 3 | 4, 0xFFFF_FFFC, [EXTENDED]),
        (1, 0, 4, 4, [EXTENDED]),
        (1, 1, 0x123 << 21, 0x124 << 21, [STANDARD]),
        (0, 0, 0xFFE0_0000 | 0x123 << 5, 0, [EXTENDED, STANDARD]),  # the second pair lets all in
        (0, 0, 0xFFE8_0000 | 0x123 << 5, 0xFFE8_0000 | 0x124 << 5, [STANDARD]),
        (0, 1, 0x124 << 5, 0x125 << 5 | 0x123 << 21, [STANDARD]),
        (0, 1, (0x1234_5678 >> 18) << 5 | 8 | 0x1234_5678 >> 15 & 7, 0, [EXTENDED]),
    ],
)
def test_filters(program: Program, scale: int, mode: int, first: int, second: int, let_in: list[CanFrame]) -> None:
    open_can(program, scale, mode, first, second)
    program.chip.can.receive([EXTENDED, STANDARD])
    program.chip.can.deliver()
    assert read_fifo(program) == let_in


def test_a_filter_chooses_the_fifo(program: Program) -> None:
    open_can(program, 1, 0, 0, fifo=1)
    program.chip.can.receive([EXTENDED])
    program.chip.can.deliver()
    assert program.asked_for(CAN1_RX1_IRQ)
    assert not program.asked_for(CAN1_RX0_IRQ)
    assert read_fifo(program, 1) == [EXTENDED]


@pytest.mark.parametrize(
    ("btr", "out", "back"), [(0, 1, 0), (1 << 30, 1, 1), (3 << 30, 0, 1), (1 << 31, 0, 0)], ids=str
)
def test_frames_go_out_of_three_mailboxes(program: Program, btr: int, out: int, back: int) -> None:
    open_can(program, 1, 0, 0, btr=btr)
    sent = [EXTENDED, STANDARD, CanFrame(7, b"")]
    assert program.get(CAN1 + 8) >> 26 & 7 == 7
    for mailbox, frame in enumerate(sent):
        base = CAN1 + 0x180 + 0x10 * mailbox
        data = frame.data.ljust(8, b"\0")
        program.put(base + 4, len(frame.data))
        program.put(base + 8, int.from_bytes(data[:4], "little"))
        program.put(base + 12, int.from_bytes(data[4:], "little"))
        program.put(base, (frame.id << 3 | 4 if frame.extended else frame.id << 21) | 1)
    assert program.chip.can.take_output() == sent * out
    program.chip.can.deliver()
    assert read_fifo(program) == sent * back
    assert program.asked_for(CAN1_TX_IRQ)
    assert program.get(CAN1 + 8) & 0x030303 == 0x030303, "three completed, three well"
    program.put(CAN1 + 8, 0x010101)
    assert program.get(CAN1 + 8) & 0xFFFFFF == 0


def test_a_controller_that_is_not_on_the_bus_takes_no_part(program: Program) -> None:
    program.chip.can.receive([EXTENDED])
    assert not program.chip.can.deliver()
    program.put(CAN1 + 0x180, 7 << 21 | 1)
    assert program.chip.can.take_output() == []
    open_can(program, 1, 0, 0)
    assert program.chip.can.take_output() == [CanFrame(7, b"", extended=False)], "it goes out when the bus is joined"
    program.chip.can.deliver()
    assert read_fifo(program) == [EXTENDED]
