"""Serial ports (RM0090, section 30): bytes by register, with interrupts."""

from collections import deque
from collections.abc import Callable
from typing import ClassVar

from firmware_stub.emulation.peripheral import Peripheral, Time
from hil.common.clock import NEVER_NS, NS_PER_S

SR, DR, BRR, CR1 = 0x00, 0x04, 0x08, 0x0C
ORE, RXNE, TXE = 1 << 3, 1 << 5, 1 << 7
RE, TE, RXNEIE, TXEIE, UE = 1 << 2, 1 << 3, 1 << 5, 1 << 7, 1 << 13
BITS = 10  # of a byte: start bit, eight of data, stop bit
LINE_CAPACITY = 4096  # bytes on the line, as in a terminal's buffer; more are lost
AT_ONCE = 16  # unpaced bytes that a program may read before it has to sleep; no program has a smaller buffer


class Usart(Peripheral):
    """A serial port and its line: bytes come in by `receive`, and go out by `take_output`.

    bus_hz: returns the frequency of its bus. interrupt: called with whether it requests its interrupt. With `paced`
    every byte takes the time from start bit to stop bit at the baud rate of its registers; otherwise none. `lost`
    counts bytes that came while it was not receiving, overran the previous one, or exceeded the line's buffer.
    Not modelled: DMA, other formats than 8N1, an idle line, framing errors, break, hardware flow control, wake-up.
    """

    RESET: ClassVar[dict[int, int]] = {SR: TXE}

    def __init__(self, time: Time, bus_hz: Callable[[], int], interrupt: Callable[[bool], None], paced: bool) -> None:
        super().__init__()
        self._time = time
        self._bus_hz = bus_hz
        self._interrupt = interrupt
        self._paced = paced
        self._on_line: deque[int] = deque()  # bytes to the port
        self._sent = bytearray()  # bytes that the port has sent completely
        self.lost = 0
        self.reset()

    def reset(self) -> None:
        """Reset to the state after a reset of the chip. Bytes on the line stay there."""
        super().reset()
        self._data = 0  # the data register, as read
        self._clears = False  # the status was read: reading the data clears ORE
        self._at_once = 0
        self._shifted: int | None = None  # the byte going out, paced
        self._next: int | None = None  # the byte after it
        self._sent_ns = NEVER_NS
        self._received_ns = NEVER_NS  # when the byte that is coming in is complete
        self._update()

    def receive(self, data: bytes) -> None:
        """Put bytes on the line, after those that are still arriving."""
        taken = data[: LINE_CAPACITY - len(self._on_line)]
        self.lost += len(data) - len(taken)
        self._on_line.extend(taken)
        if self._paced and self._received_ns == NEVER_NS and data:
            self._received_ns = self._time.now_ns + self.byte_ns()
            self._update()

    def take_output(self) -> bytes:
        """Return the bytes that were sent since the last call."""
        data = bytes(self._sent)
        self._sent.clear()
        return data

    def deliver(self) -> bool:
        """Deliver the next unpaced bytes, each when the program has read the previous one; return whether any were."""
        if self._paced or not self._on_line:
            return False
        self._at_once = AT_ONCE
        self._take_byte()
        self._update()
        return True

    def byte_ns(self) -> int:
        """Return the duration of a byte (ns), from the bus's frequency and the divider in BRR (RM0090, 30.3.4)."""
        return max(1, BITS * self.registers.get(BRR, 0) * NS_PER_S // self._bus_hz())

    def read(self, offset: int) -> int:
        """Read a register; reading the data makes room for the next byte."""
        if offset == DR:
            return self._read_data()
        if offset == SR:
            self._clears = True
        return self.registers.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        """Write a register; a write to the data register sends the byte. The status cannot be written."""
        if offset == DR:
            self._send(value & 0xFF)
            if not self._paced:
                return  # the byte is sent at once, and no flag changes
        elif offset != SR:
            self.registers[offset] = value
        self._update()

    def tick(self) -> None:
        """Complete the byte that is sent or received now."""
        now = self._time.now_ns
        if self._sent_ns <= now:
            self._finish_sending()
        if self._received_ns <= now:
            self._take_byte()
            self._received_ns = now + self.byte_ns() if self._on_line else NEVER_NS
        self._update()

    def _read_data(self) -> int:
        data, fresh = self._data, self.registers[SR] & RXNE
        if self._at_once > 1 and self._on_line and self._stays_ready():
            self._at_once -= 1
            self._data = self._on_line.popleft()
            return data
        self.registers[SR] &= ~(RXNE | ORE if self._clears else RXNE)
        self._clears = False
        if fresh and not self._paced and self._at_once > 1 and self._on_line:
            self._at_once -= 1
            self._take_byte()
        self._update()
        return data

    def _stays_ready(self) -> bool:
        """Return True if no flag changes when the next byte follows at once (unpaced)."""
        return self.registers[SR] & (RXNE | ORE) == RXNE and self._is_on(RE)

    def _is_on(self, direction: int) -> bool:
        return self.registers.get(CR1, 0) & (UE | direction) == UE | direction

    def _take_byte(self) -> None:
        byte = self._on_line.popleft()
        if not self._is_on(RE):
            self.lost += 1
        elif self.registers[SR] & RXNE:
            self.lost += 1
            self.registers[SR] |= ORE
        else:
            self._data = byte
            self.registers[SR] |= RXNE

    def _send(self, byte: int) -> None:
        if not self._is_on(TE):
            return
        if not self._paced:
            self._sent.append(byte)
        elif self._shifted is None:
            self._shifted = byte
            self._sent_ns = self._time.now_ns + self.byte_ns()
        else:
            self._next = byte
            self.registers[SR] &= ~TXE

    def _finish_sending(self) -> None:
        if self._shifted is not None:
            self._sent.append(self._shifted)
        self._shifted, self._next = self._next, None
        self.registers[SR] |= TXE
        self._sent_ns = NEVER_NS if self._shifted is None else self._time.now_ns + self.byte_ns()

    def _update(self) -> None:
        """Update the interrupt line and, if paced, the time of the next event."""
        status, enabled = self.registers[SR], self.registers.get(CR1, 0)
        # each flag has the same bit as its enable; an overrun uses the enable of RXNE
        flags = status & enabled & (RXNEIE | TXEIE)
        self._interrupt(bool(enabled & UE and (flags or (status & ORE and enabled & RXNEIE))))
        if self._paced:
            self.due_ns = min(self._sent_ns, self._received_ns)
