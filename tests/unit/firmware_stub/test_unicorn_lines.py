"""The emulated STM32F405's serial port and CAN controller."""

import pytest

from hil.links.wires.can_frame import CanFrame
from tests.support.firmware.unicorn_program import (
    CAN1,
    CAN1_RX0_IRQ,
    CAN1_RX1_IRQ,
    CAN1_TX_IRQ,
    MS,
    USART1,
    USART1_IRQ,
    Program,
    program,
)

__all__ = ["program"]  # the fixtures


def open_usart(program: Program, interrupts: int = 1 << 5) -> None:
    program.full_speed()
    program.put(USART1 + 8, 729)  # 84 MHz / 729 = 115226 bit/s
    program.put(USART1 + 0xC, 1 << 13 | 1 << 3 | 1 << 2 | interrupts)


def test_received_bytes_wait_until_the_program_reads_them(program: Program) -> None:
    port = program.chip.usarts["USART1"]
    open_usart(program)
    port.receive(bytes(range(20)))
    received = b""
    for group in (16, 4):
        assert port.deliver()
        assert program.is_pending(USART1_IRQ)
        while program.get(USART1) & 1 << 5:
            received += bytes([program.get(USART1 + 4)])
        assert len(received) % 16 == group % 16
    assert received == bytes(range(20))
    assert program.get(USART1) & 1 << 4, "the line is idle"
    assert not port.deliver()


def test_an_unread_byte_is_overrun(program: Program) -> None:
    port = program.chip.usarts["USART1"]
    open_usart(program)
    port.receive(b"ab")
    port.deliver()
    port.deliver()
    assert program.get(USART1) & 0x28 == 0x28
    assert program.get(USART1 + 4) == ord("a")
    assert program.get(USART1) & 0x28 == 0, "reading status, then data, clears the overrun"
    assert port.lost == 1


def test_a_disabled_port_neither_receives_nor_sends(program: Program) -> None:
    port = program.chip.usarts["USART1"]
    program.put(USART1 + 4, ord("x"))
    port.receive(b"abc")
    while port.deliver():
        pass
    assert (port.take_output(), port.lost, program.get(USART1) & 1 << 5) == (b"", 3, 0)


def test_an_empty_transmit_register_raises_its_interrupt(program: Program) -> None:
    open_usart(program, interrupts=1 << 7)
    assert program.is_pending(USART1_IRQ)
    program.put(USART1 + 4, ord("o"), size=1)
    program.put(USART1 + 4, ord("k"), size=2)
    assert program.chip.usarts["USART1"].take_output() == b"ok"


@pytest.mark.parametrize(("cr1", "cr2", "bits"), [(0, 0, 10), (1 << 12, 0, 11), (0, 2 << 12, 11)])
def test_paced_bytes_take_their_transmission_time_both_ways(cr1: int, cr2: int, bits: int) -> None:
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


def test_a_paced_byte_that_is_read_too_late_is_lost() -> None:
    program = Program(paced=True)
    open_usart(program)
    program.chip.usarts["USART1"].receive(b"abc")
    program.wait_until(MS)
    assert program.get(USART1) & 0x28 == 0x28
    assert (program.get(USART1 + 4), program.chip.usarts["USART1"].lost) == (ord("a"), 2)


def open_can(program: Program, scale: int, mode: int, first: int, second: int = 0, fifo: int = 0, btr: int = 0) -> None:
    """Initialise the controller with one filter, in bank 3."""
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
    """Empty the FIFO as a program does; return its frames."""
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


def test_received_frames_pass_the_fifo_without_loss(program: Program) -> None:
    open_can(program, scale=1, mode=0, first=0)
    frames = [CanFrame(i, bytes([i])) for i in range(10)] + [STANDARD]
    program.chip.can.receive(frames)
    program.chip.can.deliver()
    assert program.is_pending(CAN1_RX0_IRQ)
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
def test_filters_accept_the_configured_identifiers(
    program: Program, scale: int, mode: int, first: int, second: int, let_in: list[CanFrame]
) -> None:
    open_can(program, scale, mode, first, second)
    program.chip.can.receive([EXTENDED, STANDARD])
    program.chip.can.deliver()
    assert read_fifo(program) == let_in


def test_a_filter_selects_the_fifo(program: Program) -> None:
    open_can(program, 1, 0, 0, fifo=1)
    program.chip.can.receive([EXTENDED])
    program.chip.can.deliver()
    assert program.is_pending(CAN1_RX1_IRQ)
    assert not program.is_pending(CAN1_RX0_IRQ)
    assert read_fifo(program, 1) == [EXTENDED]


@pytest.mark.parametrize(
    ("btr", "out", "is_received"), [(0, 1, 0), (1 << 30, 1, 1), (3 << 30, 0, 1), (1 << 31, 0, 0)], ids=str
)
def test_frames_are_sent_from_three_mailboxes(program: Program, btr: int, out: int, is_received: int) -> None:
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
    assert read_fifo(program) == sent * is_received
    assert program.is_pending(CAN1_TX_IRQ)
    assert program.get(CAN1 + 8) & 0x030303 == 0x030303, "three completed, three well"
    program.put(CAN1 + 8, 0x010101)
    assert program.get(CAN1 + 8) & 0xFFFFFF == 0


def test_a_controller_off_the_bus_neither_receives_nor_sends(program: Program) -> None:
    program.chip.can.receive([EXTENDED])
    assert not program.chip.can.deliver()
    program.put(CAN1 + 0x180, 7 << 21 | 1)
    assert program.chip.can.take_output() == []
    open_can(program, 1, 0, 0)
    assert program.chip.can.take_output() == [CanFrame(7, b"", extended=False)], "it goes out when the bus is joined"
    program.chip.can.deliver()
    assert read_fifo(program) == [EXTENDED]
