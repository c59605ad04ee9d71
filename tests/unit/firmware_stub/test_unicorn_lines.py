"""The emulated STM32F405's serial port and CAN controller."""

from hil.links.wires.can_frame import CanFrame
from tests.support.firmware.unicorn_program import (
    CAN1,
    CAN1_RX0_IRQ,
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
    port = program.chip.usart
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
    assert not port.deliver()


def test_an_unread_byte_is_overrun(program: Program) -> None:
    port = program.chip.usart
    open_usart(program)
    port.receive(b"ab")
    port.deliver()
    port.deliver()
    assert program.get(USART1) & 0x28 == 0x28
    assert program.get(USART1 + 4) == ord("a")
    assert program.get(USART1) & 0x28 == 0, "reading status, then data, clears the overrun"
    assert port.lost == 1


def test_a_disabled_port_neither_receives_nor_sends(program: Program) -> None:
    port = program.chip.usart
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
    assert program.chip.usart.take_output() == b"ok"


def test_paced_bytes_take_their_transmission_time_both_ways() -> None:
    program = Program(paced=True)
    port = program.chip.usart
    open_usart(program, 0)
    byte_ns = 10 * 729 * 1000 // 84
    port.receive(b"abc")
    program.put(USART1 + 4, ord("x"))
    assert program.get(USART1) & 0x80, "the first one is on its way, there is room for another"
    program.put(USART1 + 4, ord("y"))
    assert not program.get(USART1) & 0x80
    program.wait_until(byte_ns - 1)
    assert (port.take_output(), program.get(USART1) & 0x20) == (b"", 0)
    program.wait_until(byte_ns)
    assert (port.take_output(), program.get(USART1 + 4)) == (b"x", ord("a"))
    program.wait_until(2 * byte_ns)
    assert (port.take_output(), program.get(USART1 + 4)) == (b"y", ord("b"))


def test_a_paced_byte_that_is_read_too_late_is_lost() -> None:
    program = Program(paced=True)
    open_usart(program)
    program.chip.usart.receive(b"abc")
    program.wait_until(MS)
    assert program.get(USART1) & 0x28 == 0x28
    assert (program.get(USART1 + 4), program.chip.usart.lost) == (ord("a"), 2)


def open_can(program: Program, wanted: int = 0, mask: int = 0) -> None:
    """Initialise the controller with a filter."""
    program.put(CAN1, 1)
    assert program.get(CAN1 + 4) & 3 == 1, "initialisation is acknowledged"
    program.put(CAN1 + 0x21C, 1)
    program.put(CAN1 + 0x240, wanted)
    program.put(CAN1 + 0x244, mask)
    program.put(CAN1 + 0x200, 0x2A1C_0E00)
    program.put(CAN1 + 0x14, 0b11)
    program.put(CAN1, 0)
    assert program.get(CAN1 + 4) & 3 == 0


def read_fifo(program: Program) -> list[CanFrame]:
    """Empty the FIFO as a program does; return its frames."""
    frames = []
    while program.get(CAN1 + 0x0C) & 3:
        marked, size, low, high = (program.get(CAN1 + 0x1B0 + place) for place in (0, 4, 8, 12))
        extended = bool(marked & 4)
        data = (low | high << 32).to_bytes(8, "little")[: size & 15]
        frames.append(CanFrame(marked >> 3 if extended else marked >> 21, data, extended))
        program.put(CAN1 + 0x0C, 1 << 5)
    return frames


EXTENDED, STANDARD = CanFrame(0x1234_5678, b"12345678"), CanFrame(0x123, b"ab", extended=False)


def test_received_frames_pass_the_fifo_without_loss(program: Program) -> None:
    open_can(program)
    frames = [CanFrame(i, bytes([i])) for i in range(10)] + [STANDARD]
    program.chip.can.receive(frames)
    program.chip.can.deliver()
    assert program.is_pending(CAN1_RX0_IRQ)
    assert program.get(CAN1 + 0x0C) & 3 == 3, "it has three"
    assert read_fifo(program) == frames


def test_a_filter_accepts_the_configured_identifiers(program: Program) -> None:
    open_can(program, 0x1234_5678 << 3 | 4, 0xFFFF_FFFC)
    program.chip.can.receive([STANDARD, EXTENDED, EXTENDED._replace(id=1)])
    program.chip.can.deliver()
    assert read_fifo(program) == [EXTENDED]


def send(program: Program, mailbox: int, frame: CanFrame) -> None:
    base, data = CAN1 + 0x180 + 0x10 * mailbox, frame.data.ljust(8, b"\0")
    program.put(base + 4, len(frame.data))
    program.put(base + 8, int.from_bytes(data[:4], "little"))
    program.put(base + 12, int.from_bytes(data[4:], "little"))
    program.put(base, (frame.id << 3 | 4 if frame.extended else frame.id << 21) | 1)


def test_frames_are_sent_from_three_mailboxes(program: Program) -> None:
    open_can(program)
    sent = [EXTENDED, STANDARD, CanFrame(7, b"")]
    assert program.get(CAN1 + 8) >> 26 & 7 == 7
    for mailbox, frame in enumerate(sent):
        send(program, mailbox, frame)
    assert program.chip.can.take_output() == sent
    assert program.is_pending(CAN1_TX_IRQ)
    assert program.get(CAN1 + 8) & 0x010101 == 0x010101, "three completed"
    program.put(CAN1 + 8, 0x010101)
    assert program.get(CAN1 + 8) & 0xFFFFFF == 0


def test_a_controller_off_the_bus_neither_receives_nor_sends(program: Program) -> None:
    program.chip.can.receive([EXTENDED])
    assert not program.chip.can.deliver()
    send(program, 0, STANDARD)
    assert program.chip.can.take_output() == []
    assert program.get(CAN1 + 8) >> 26 & 7 == 6, "its mailbox is not empty"
    open_can(program)
    program.chip.can.deliver()
    assert read_fifo(program) == [EXTENDED]
