"""CAN controller bxCAN (RM0090, section 32): frames, mailboxes, one FIFO and one filter, without bit timing."""

from collections import deque
from collections.abc import Callable
from typing import ClassVar

from firmware_stub.emulation.peripheral import Peripheral
from hil.links.wires.can_frame import CanFrame

MCR, MSR, TSR, RF0R, IER = 0x00, 0x04, 0x08, 0x0C, 0x14
TRANSMIT, MAILBOX_SIZE, MAILBOXES = 0x180, 0x10, 3
RECEIVE, RECEIVE_END = 0x1B0, 0x1C0
FMR, FA1R, FILTER = 0x200, 0x21C, 0x240
INRQ, SLEEP = 1, 2
RQCP, TXRQ, RFOM = 1, 1, 1 << 5
ALL_DONE = RQCP | RQCP << 8 | RQCP << 16
TMEIE, FMPIE = 1, 1 << 1
REMOTE, EXTENDED = 2, 4
FIFO_DEPTH = 3


class BxCan(Peripheral):
    """A CAN controller and its bus: frames come in by `receive`, and go out by `take_output`.

    transmit, receive_0: called with whether that interrupt is requested. A frame takes no time. Frames wait on the bus
    until the FIFO has room, so none is lost.
    Not modelled: bit timing, arbitration, remote frames, bus errors, time stamps, loopback, the second FIFO, and other
    filters than a mask of 32 bits in bank 0.
    """

    RESET: ClassVar[dict[int, int]] = {MCR: 0x0001_0002, MSR: 0x0000_0C02, TSR: 0x1C00_0000, FMR: 0x2A1C_0E01}

    def __init__(self, transmit: Callable[[bool], None], receive_0: Callable[[bool], None]) -> None:
        super().__init__()
        self._transmit = transmit
        self._receive_0 = receive_0
        self._on_bus: deque[CanFrame] = deque()
        self._sent: list[CanFrame] = []
        self.reset()

    def reset(self) -> None:
        """Reset the controller. Frames that wait on the bus stay there."""
        super().reset()
        self._fifo: deque[CanFrame] = deque()
        self._update()

    def receive(self, frames: list[CanFrame]) -> None:
        """Put frames of other nodes on the bus."""
        self._on_bus.extend(frames)

    def take_output(self) -> list[CanFrame]:
        """Return the frames sent since the last call."""
        sent, self._sent = self._sent, []
        return sent

    def deliver(self) -> bool:
        """Move waiting frames from the bus into the FIFO, as far as it has room; return whether any was moved."""
        has_moved = False
        while self._on_bus and self._is_on() and len(self._fifo) < FIFO_DEPTH:
            frame = self._on_bus.popleft()
            if self._is_accepted(frame):
                self._fifo.append(frame)
            has_moved = True
        if has_moved:
            self._update()
        return has_moved

    def read(self, offset: int) -> int:
        """Return a register, or the frame at the head of the FIFO."""
        if RECEIVE <= offset < RECEIVE_END:
            return self._read_frame(offset - RECEIVE)
        return len(self._fifo) if offset == RF0R else self.registers.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        """Write a register; some bits request an action."""
        if offset == MCR:
            self.registers[MCR] = value
            acknowledged = INRQ if value & INRQ else value & SLEEP  # at once
            self.registers[MSR] = self.registers[MSR] & ~3 | acknowledged
        elif offset == TSR:
            self.registers[TSR] &= ~(value & ALL_DONE)  # cleared by writing 1
        elif offset == RF0R:
            if value & RFOM and self._fifo:
                self._fifo.popleft()
                self.deliver()
        else:
            self.registers[offset] = value
            if TRANSMIT <= offset < RECEIVE and offset % MAILBOX_SIZE == 0 and value & TXRQ and self._is_on():
                self._send((offset - TRANSMIT) // MAILBOX_SIZE)
        self._update()

    def _is_on(self) -> bool:
        return not self.registers[MCR] & (INRQ | SLEEP)

    def _send(self, mailbox: int) -> None:
        base = TRANSMIT + mailbox * MAILBOX_SIZE
        marked_id = self.registers[base] & ~TXRQ
        self.registers[base] = marked_id
        self.registers[TSR] |= RQCP << 8 * mailbox
        size = min(self.registers.get(base + 4, 0) & 15, 8)
        data = b"".join(self.registers.get(base + place, 0).to_bytes(4, "little") for place in (8, 12))[:size]
        extended = bool(marked_id & EXTENDED)
        if not marked_id & REMOTE:
            self._sent.append(CanFrame(marked_id >> 3 if extended else marked_id >> 21, data, extended))

    def _read_frame(self, register: int) -> int:
        if not self._fifo:
            return 0
        frame = self._fifo[0]
        if register == 0:
            return _identifier(frame)
        if register == 4:
            return len(frame.data)
        return int.from_bytes(frame.data.ljust(8, b"\0")[register - 8 : register - 4], "little")

    def _is_accepted(self, frame: CanFrame) -> bool:
        """Return whether the filter accepts the frame; none does before it is initialised (RM0090, 32.7.4)."""
        wanted, mask = (self.registers.get(FILTER + place, 0) for place in (0, 4))
        is_active = self.registers.get(FA1R, 0) & 1 and not self.registers[FMR] & 1
        return bool(is_active) and not (_identifier(frame) ^ wanted) & mask

    def _update(self) -> None:
        """Update the flags of empty mailboxes, and the interrupt lines."""
        done = self.registers[TSR] & ALL_DONE
        empty = [n for n in range(MAILBOXES) if not self.registers.get(TRANSMIT + n * MAILBOX_SIZE, 0) & TXRQ]
        self.registers[TSR] = done | sum(1 << 26 + n for n in empty)
        enabled = self.registers.get(IER, 0)
        self._transmit(bool(enabled & TMEIE and done))
        self._receive_0(bool(enabled & FMPIE and self._fifo))


def _identifier(frame: CanFrame) -> int:
    """Return the identifier in the layout of the registers (RM0090, 32.9.3)."""
    return frame.id << 3 | EXTENDED if frame.extended else frame.id << 21
