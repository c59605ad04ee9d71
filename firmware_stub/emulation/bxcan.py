"""CAN controller bxCAN (RM0090, section 32): frames, mailboxes, FIFOs and filters, without bit timing."""

from collections import deque
from collections.abc import Callable
from typing import ClassVar

from firmware_stub.emulation.peripheral import WORD, Peripheral
from hil.links.wires.can_frame import CanFrame

MCR, MSR, TSR, RF0R, RF1R, IER, ESR, BTR = 0x00, 0x04, 0x08, 0x0C, 0x10, 0x14, 0x18, 0x1C
TRANSMIT, MAILBOX_SIZE, MAILBOXES = 0x180, 0x10, 3
RECEIVE, RECEIVE_END = 0x1B0, 0x1D0
FMR, FM1R, FS1R, FFA1R, FA1R, FILTERS = 0x200, 0x204, 0x20C, 0x214, 0x21C, 0x240
INRQ, SLEEP, ABOM_RESET = 1, 2, 1 << 15
RQCP, TXOK, ABRQ, TXRQ = 1, 2, 1 << 7, 1
FULL, RFOM = 1 << 3, 1 << 5
TMEIE, FMPIE, FFIE = 1, 1 << 1, 1 << 2
LOOPBACK, SILENT, REMOTE, EXTENDED = 1 << 30, 1 << 31, 2, 4
FIFO_DEPTH = 3
BANKS = 28


class BxCan(Peripheral):
    """A CAN controller and its bus: frames come in by `receive`, and go out by `take_output`.

    transmit, receive_0, receive_1: called with whether that interrupt is requested. A frame takes no time. Frames wait
    on the bus until their FIFO has room, so none is lost.
    Not modelled: bit timing, arbitration, remote frames, bus errors, time stamps, the second controller.
    """

    RESET: ClassVar[dict[int, int]] = {
        MCR: 0x0001_0002, MSR: 0x0000_0C02, TSR: 0x1C00_0000, BTR: 0x0123_0000, FMR: 0x2A1C_0E01
    }  # fmt: skip

    def __init__(
        self,
        transmit: Callable[[bool], None],
        receive_0: Callable[[bool], None],
        receive_1: Callable[[bool], None],
    ) -> None:
        super().__init__()
        self._transmit = transmit
        self._receive = (receive_0, receive_1)
        self._on_bus: deque[CanFrame] = deque()
        self._sent: list[CanFrame] = []
        self.reset()

    def reset(self) -> None:
        """Reset the controller. Frames that wait on the bus stay there."""
        super().reset()
        self._fifos: tuple[deque[tuple[CanFrame, int]], ...] = (deque(), deque())  # each with its filter's index
        self._update()

    def receive(self, frames: list[CanFrame]) -> None:
        """Put frames of other nodes on the bus."""
        self._on_bus.extend(frames)

    def take_output(self) -> list[CanFrame]:
        """Return the frames sent since the last call."""
        sent, self._sent = self._sent, []
        return sent

    def deliver(self) -> bool:
        """Move waiting frames from the bus into the FIFOs, as far as these have room; return whether any was moved."""
        if not self._on_bus:
            return False
        has_moved = False
        while self._on_bus and self._is_on():
            frame = self._on_bus[0]
            match = self._match(frame)
            if match is not None and len(self._fifos[match[0]]) == FIFO_DEPTH:
                break
            self._on_bus.popleft()
            if match is not None:
                self._fifos[match[0]].append((frame, match[1]))
            has_moved = True
        self._update()
        return has_moved

    def read(self, offset: int) -> int:
        """Return a register, or the frame at the head of a FIFO."""
        if RECEIVE <= offset < RECEIVE_END:
            return self._read_frame((offset - RECEIVE) // MAILBOX_SIZE, offset % MAILBOX_SIZE)
        if offset in (RF0R, RF1R):
            held = len(self._fifos[offset == RF1R])
            return held | (FULL if held == FIFO_DEPTH else 0)
        return self.registers.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        """Write a register; some bits request an action."""
        if offset == MCR:
            self._set_mode(value)
        elif offset == TSR:
            self._write_tsr(value)
        elif offset in (RF0R, RF1R):
            self._release(offset == RF1R, value)
        elif offset not in (MSR, ESR) and not RECEIVE <= offset < RECEIVE_END:
            self.registers[offset] = value
            if TRANSMIT <= offset < RECEIVE and offset % MAILBOX_SIZE == 0 and value & TXRQ and self._is_on():
                self._send((offset - TRANSMIT) // MAILBOX_SIZE)
        self._update()

    def _is_on(self) -> bool:
        return not self.registers[MCR] & (INRQ | SLEEP)

    def _set_mode(self, value: int) -> None:
        """Set the mode; initialisation and sleep are acknowledged at once."""
        if value & ABOM_RESET:
            self.reset()
            return
        self.registers[MCR] = value
        acknowledged = INRQ if value & INRQ else value & SLEEP
        self.registers[MSR] = self.registers[MSR] & ~3 | acknowledged
        if self._is_on():
            self._send_waiting()

    def _send_waiting(self) -> None:
        for mailbox in range(MAILBOXES):
            if self.registers.get(TRANSMIT + mailbox * MAILBOX_SIZE, 0) & TXRQ:
                self._send(mailbox)

    def _send(self, mailbox: int) -> None:
        base = TRANSMIT + mailbox * MAILBOX_SIZE
        marked_id = self.registers[base] & ~TXRQ
        self.registers[base] = marked_id
        self.registers[TSR] |= (RQCP | TXOK) << 8 * mailbox
        if marked_id & REMOTE:
            return
        size = min(self.registers.get(base + 4, 0) & 15, 8)
        data = b"".join(self.registers.get(base + place, 0).to_bytes(4, "little") for place in (8, 12))[:size]
        extended = bool(marked_id & EXTENDED)
        frame = CanFrame(marked_id >> 3 if extended else marked_id >> 21, data, extended)
        mode = self.registers[BTR]
        if not mode & SILENT:
            self._sent.append(frame)
        if mode & LOOPBACK:
            self._on_bus.append(frame)

    def _write_tsr(self, value: int) -> None:
        """Write TSR: a 1 to a mailbox's "completed" clears its four results."""
        for mailbox in range(MAILBOXES):
            if value >> 8 * mailbox & RQCP:
                self.registers[TSR] &= ~(0xF << 8 * mailbox)
            if value >> 8 * mailbox & ABRQ:
                self.registers[TRANSMIT + mailbox * MAILBOX_SIZE] = 0

    def _release(self, fifo: int, value: int) -> None:
        if value & RFOM and self._fifos[fifo]:
            self._fifos[fifo].popleft()
            self.deliver()

    def _read_frame(self, fifo: int, register: int) -> int:
        if not self._fifos[fifo]:
            return 0
        frame, index = self._fifos[fifo][0]
        if register == 0:
            return _identifier(frame)
        if register == 4:
            return index << 8 | len(frame.data)
        return int.from_bytes(frame.data.ljust(8, b"\0")[register - 8 : register - 4], "little")

    def _match(self, frame: CanFrame) -> tuple[int, int] | None:
        """Return FIFO and filter index of the first filter that accepts the frame (RM0090 32.7.4)."""
        active, fifos = self.registers.get(FA1R, 0), self.registers.get(FFA1R, 0)
        if self.registers[FMR] & 1:  # in filter initialisation mode no frame is received
            return None
        indices = [0, 0]
        for bank in range(BANKS):
            fifo = fifos >> bank & 1
            rules = self._rules(bank)
            if active >> bank & 1:
                for place, (wanted, mask) in enumerate(rules):
                    if not (_filter_identifier(frame, self._is_narrow(bank)) ^ wanted) & mask:
                        return fifo, indices[fifo] + place
            indices[fifo] += len(rules)
        return None

    def _is_narrow(self, bank: int) -> bool:
        return not self.registers.get(FS1R, 0) >> bank & 1

    def _rules(self, bank: int) -> list[tuple[int, int]]:
        """Return the wanted bits and the mask of each filter in a bank (RM0090, figure 342)."""
        first, second = (self.registers.get(FILTERS + 8 * bank + place, 0) for place in (0, 4))
        is_list = self.registers.get(FM1R, 0) >> bank & 1
        if not self._is_narrow(bank):
            return [(first, WORD), (second, WORD)] if is_list else [(first, second)]
        halves = [half for word in (first, second) for half in (word & 0xFFFF, word >> 16)]
        if is_list:
            return [(half, 0xFFFF) for half in halves]
        return [(halves[0], halves[1]), (halves[2], halves[3])]

    def _update(self) -> None:
        """Update the flags of empty mailboxes, and the interrupt lines."""
        tsr = self.registers[TSR] & ~0x1F00_0000
        empty = [n for n in range(MAILBOXES) if not self.registers.get(TRANSMIT + n * MAILBOX_SIZE, 0) & TXRQ]
        self.registers[TSR] = tsr | sum(1 << 26 + n for n in empty) | (empty[0] if empty else 0) << 24
        enabled = self.registers.get(IER, 0)
        self._transmit(bool(enabled & TMEIE and tsr & (RQCP | RQCP << 8 | RQCP << 16)))
        for fifo, interrupt in enumerate(self._receive):
            held, wanted = len(self._fifos[fifo]), enabled >> 3 * fifo
            interrupt(bool((wanted & FMPIE and held) or (wanted & FFIE and held == FIFO_DEPTH)))


def _identifier(frame: CanFrame) -> int:
    """Return the identifier in the layout of the registers (RM0090, 32.9.3)."""
    return frame.id << 3 | EXTENDED if frame.extended else frame.id << 21


def _filter_identifier(frame: CanFrame, narrow: bool) -> int:
    """Return the identifier in the layout of a filter: 32 bits or, if `narrow`, STID[10:0] RTR IDE EXID[17:15]."""
    if not narrow:
        return _identifier(frame)
    if frame.extended:
        return (frame.id >> 18) << 5 | 1 << 3 | frame.id >> 15 & 7
    return frame.id << 5
