"""CAN buses as wires through the python-can package, see `hil.links.wires.can_bus`.

"virtual" connects the ends within one process, "udp_multicast" (which also needs msgpack) those on one machine;
python-can has drivers for the adapters of many manufacturers. The package costs 130 ms and 18 MiB at its first use.
"""

import contextlib
import errno
import os
import queue
import sys
import threading
from collections import deque
from typing import TYPE_CHECKING, Any

from hil.common.errors import DeviceError, MissingExtraError
from hil.links.contract import Wire
from hil.links.wires.can_bus import BITRATE, MAX_FRAMES
from hil.links.wires.can_frame import RECORD_SIZE, CanFrame, pack_frame, unpack_frames

if TYPE_CHECKING:
    from can import BusABC, Message


class PythonCanWire(Wire):
    """A bus of the python-can package: `interface` and `channel` as in python-can, `bitrate` in bit/s.

    With "udp_multicast", frames stay on this machine. If one of our frames is lost on its way back to us, the next
    identical frame of another sender is taken for it and dropped. Raises DeviceError if the bus cannot be opened;
    MissingExtraError without the package.
    """

    record_size = RECORD_SIZE
    MAX_ECHOES = 1024  # more than the socket's buffer holds

    def __init__(self, interface: str, channel: str, bitrate: int = BITRATE) -> None:
        self.name = f"can:{interface}:{channel}"
        self._bus: BusABC | None = _open_bus(self.name, interface, channel, bitrate)
        self._can = sys.modules["can"]  # an import statement for each frame would cost as much as sending it
        # Only this bus returns the frames that we send, and does not mark them.
        self._echoes: deque[bytes] | None = deque(maxlen=self.MAX_ECHOES) if interface == "udp_multicast" else None
        self._reader: _Reader | None = None
        try:
            self._fd = self._bus.fileno()
        except NotImplementedError:
            self._reader = _Reader(self._bus)
            self._fd = self._reader.fd

    def fileno(self) -> int:
        """Return the descriptor to wait on for frames; -1 once closed."""
        return self._fd

    def read(self) -> bytes:
        """Return the received frames (256 at most), or b"". Raises DeviceError if the bus is lost."""
        bus = self._opened()
        records = []
        for message in self._reader.pop_messages() if self._reader else self._messages(bus):
            record = _record_of_message(message)
            if not self._is_echo(record):
                records.append(record)
        if self._reader and self._reader.failure:
            raise self._lost_error(self._reader.failure)
        return b"".join(records)

    def discard_received(self) -> int:
        """Discard the received frames, also those that the reading thread has not taken from the bus yet."""
        if not self._reader:
            return super().discard_received()
        self._opened()
        return self._reader.discard_messages() * RECORD_SIZE

    def write(self, data: bytes) -> int:
        """Send whole records; return the bytes that the bus accepted. Raises DeviceError if the bus is lost."""
        bus = self._opened()
        for start in range(0, len(data), RECORD_SIZE):
            for frame in unpack_frames(data[start : start + RECORD_SIZE]):
                if not self._send(bus, frame):
                    return start
        return len(data)

    def close(self) -> None:
        """Close the bus. May be called twice."""
        bus, self._bus, self._fd = self._bus, None, -1
        if bus:
            if self._reader:
                self._reader.stop()
            bus.shutdown()

    def _opened(self) -> "BusABC":
        if self._bus is None:
            raise DeviceError(f"{self.name}: is closed; open it again")
        return self._bus

    def _messages(self, bus: "BusABC") -> "list[Message]":
        messages: list[Message] = []
        for _ in range(MAX_FRAMES):
            try:
                message = bus.recv(0)
            except (self._can.CanError, OSError) as error:
                if self._echoes is not None and not isinstance(error.__cause__, OSError):
                    continue  # a datagram that is not a frame
                raise self._lost_error(error) from None
            if message is None:
                break
            messages.append(message)
        return messages

    def _send(self, bus: "BusABC", frame: CanFrame) -> bool:
        if self._echoes is not None:
            self._echoes.append(pack_frame(frame))
        message = self._can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=frame.extended)
        try:
            bus.send(message, timeout=0)
        except (self._can.CanError, OSError) as error:
            cause = error if isinstance(error, OSError) else error.__cause__
            if isinstance(cause, OSError) and cause.errno not in (errno.EAGAIN, errno.ENOBUFS):
                raise self._lost_error(error) from None
            self._is_echo(pack_frame(frame))
            return False
        return True

    def _is_echo(self, record: bytes) -> bool:
        if not self._echoes or record not in self._echoes:
            return False
        self._echoes.remove(record)
        return True

    def _lost_error(self, reason: Exception) -> DeviceError:
        return DeviceError(f"{self.name}: went away ({reason}); reconnect it")


class _Reader:
    """Thread that reads a bus without a descriptor and provides one, `fd`. `failure` is the error that ended it."""

    PERIOD_S = 0.02  # polling period for `stop` and for `discard_messages`
    EMPTY_WITHIN_S = 0.5  # a bus with so much traffic that it is never empty is left to `pop_messages`

    def __init__(self, bus: "BusABC") -> None:
        self.fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self.failure: Exception | None = None
        self._bus = bus
        self._messages: queue.Queue[Message] = queue.Queue(MAX_FRAMES)
        self._stopped = threading.Event()
        self._emptied: threading.Event | None = None  # while the thread empties the bus: set when it has done so
        self._discarded = 0  # messages, since that began
        self._thread = threading.Thread(target=self._run, name=f"reader of {bus}", daemon=True)
        self._thread.start()

    def pop_messages(self) -> "list[Message]":
        """Return the messages received since the last call."""
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self.fd)
        return [self._messages.get_nowait() for _ in range(self._messages.qsize())]

    def discard_messages(self) -> int:
        """Discard the messages that wait here and in the bus; return how many. Waits for the thread.

        The bus may be read by one thread only. Its queue, of the driver or of the adapter, may hold more messages than
        the thread has room for.
        """
        self._discarded = 0
        self._emptied = emptied = threading.Event()
        if self._thread.is_alive():
            emptied.wait(self.EMPTY_WITHIN_S)
        self._emptied = None
        return self._discarded + len(self.pop_messages())

    def stop(self) -> None:
        """End the thread and close the descriptor."""
        self._stopped.set()
        self._thread.join()
        os.close(self.fd)

    def _run(self) -> None:
        from can import CanError

        try:
            while not self._stopped.is_set():
                if emptied := self._emptied:
                    self._empty_bus()
                    self._emptied = None
                    emptied.set()
                message = self._bus.recv(self.PERIOD_S)
                if message:
                    self._store(message)
        except (CanError, OSError) as error:
            self.failure = error
            os.eventfd_write(self.fd, 1)

    def _empty_bus(self) -> None:
        while self._emptied and self._bus.recv(0.0):
            self._discarded += 1

    def _store(self, message: "Message") -> None:
        while not (self._stopped.is_set() or self._emptied):
            try:
                self._messages.put(message, timeout=self.PERIOD_S)
            except queue.Full:  # nobody reads: then the bus's own queue fills and refuses frames
                continue
            os.eventfd_write(self.fd, 1)
            return
        self._discarded += 1


def _open_bus(name: str, interface: str, channel: str, bitrate: int) -> "BusABC":
    try:
        import can
    except ImportError:
        raise MissingExtraError(f"{name} needs python-can: pip install 'uuv-hil[can]'") from None
    if interface == "virtual":
        from hil.links.wires.virtual_bus import VirtualBus

        return VirtualBus(channel, MAX_FRAMES)
    own: dict[str, dict[str, Any]] = {"udp_multicast": {"hop_limit": 0, "fd": False}}
    if interface not in can.VALID_INTERFACES:
        raise DeviceError(f"{name}: python-can has no such interface; it has {', '.join(sorted(can.VALID_INTERFACES))}")
    try:
        return can.Bus(channel, interface, ignore_config=True, **own.get(interface, {"bitrate": bitrate}))
    except can.CanInterfaceNotImplementedError as error:
        raise MissingExtraError(f"{name}: {error}; pip install 'uuv-hil[can]'") from None
    except (can.CanError, OSError, ValueError) as error:
        raise DeviceError(f"{name}: {error}; check the channel, and that its adapter is plugged in") from None


def _record_of_message(message: "Message") -> bytes:
    """Return the record of a classic data frame; b"" for any other."""
    if message.is_remote_frame or message.is_error_frame or message.is_fd:
        return b""
    return pack_frame(CanFrame(message.arbitration_id, bytes(message.data), message.is_extended_id))
