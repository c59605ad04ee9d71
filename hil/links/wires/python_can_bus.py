"""CAN buses as wires through the python-can package, see `hil.links.wires.can_bus`.

It has drivers for the adapters of many manufacturers. The package costs 130 ms and 18 MiB at its first use.

The drivers are others' code: some wait for the rest of a frame, and some raise any exception for a byte that noise has
changed. So a thread reads them, a frame that a driver cannot decode is dropped, and any other failure is a DeviceError.
"""

import contextlib
import errno
import os
import queue
import sys
import threading
from typing import TYPE_CHECKING

from hil.common.errors import DeviceError, HilError, MissingExtraError
from hil.links.contract import Wire
from hil.links.wires.can_bus import BITRATE, MAX_FRAMES
from hil.links.wires.can_frame import ERROR, ID_MASK, MAX_DATA, RECORD_SIZE, CanFrame, pack_frame, unpack_frames

if TYPE_CHECKING:
    from can import BusABC, Message

DAMAGED = pack_frame(CanFrame(ERROR, b""))  # in place of a frame that its driver could not decode


class PythonCanWire(Wire):
    """A bus of the python-can package: `interface` and `channel` as in python-can, `bitrate` in bit/s.

    Raises DeviceError if the bus cannot be opened; MissingExtraError without the package.
    """

    record_size = RECORD_SIZE

    def __init__(self, interface: str, channel: str, bitrate: int = BITRATE) -> None:
        self.name = f"can:{interface}:{channel}"
        self._bus: BusABC | None = _open_bus(self.name, interface, channel, bitrate)
        self._can = sys.modules["can"]  # an import statement for each frame would cost as much as sending it
        self._reader = _Reader(self._bus)

    def fileno(self) -> int:
        """Return the descriptor to wait on for frames; -1 once closed."""
        return self._reader.fd if self._bus else -1

    def read(self) -> bytes:
        """Return the received frames (256 at most), or b"". Raises DeviceError if the bus is lost."""
        self._opened()
        try:
            return b"".join(self._reader.pop_records())
        except Exception as error:  # noqa: BLE001 - whatever a driver raises
            raise self._lost_error(error) from None

    def discard_received(self) -> int:
        """Discard the received frames, also those that the reading thread has not taken from the bus yet."""
        self._opened()
        return self._reader.discard_records() * RECORD_SIZE

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
        bus, self._bus = self._bus, None
        if bus:
            self._reader.stop()
            with contextlib.suppress(Exception):  # of a driver whose device is gone
                bus.shutdown()

    def _opened(self) -> "BusABC":
        if self._bus is None:
            raise DeviceError(f"{self.name}: is closed; open it again")
        return self._bus

    def _send(self, bus: "BusABC", frame: CanFrame) -> bool:
        message = self._can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=frame.extended)
        try:
            bus.send(message, timeout=0)
        except Exception as error:  # noqa: BLE001 - whatever a driver raises
            cause = _system_error(error)
            is_full = cause.errno in (errno.EAGAIN, errno.ENOBUFS) if cause else isinstance(error, self._can.CanError)
            if not is_full:
                raise self._lost_error(error) from None
            return False
        return True

    def _lost_error(self, reason: Exception) -> DeviceError:
        return DeviceError(f"{self.name}: went away ({_first_line(reason)}); reconnect it")


class _Reader:
    """Thread that reads a driver without delay for others; `fd` is readable when there are records.

    A frame that the driver cannot decode is `DAMAGED`; so many without any other are a failure.
    """

    PERIOD_S = 0.02  # polling period for `stop` and for `discard_messages`
    MOST_DAMAGED = 10_000
    EMPTY_WITHIN_S = 0.5  # a bus with so much traffic that it is never empty is left to `pop_messages`

    def __init__(self, bus: "BusABC") -> None:
        self.fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._failure: Exception | None = None
        self._bus = bus
        self._damaged = 0  # in a row
        self._records: queue.Queue[bytes] = queue.Queue(MAX_FRAMES)
        self._stopped = threading.Event()
        self._emptied: threading.Event | None = None  # while the thread empties the bus: set when it has done so
        self._discarded = 0  # records, since that began
        self._thread = threading.Thread(target=self._run, name="reader of a CAN driver", daemon=True)
        self._thread.start()

    def pop_records(self) -> list[bytes]:
        """Return the records received since the last call; then raise the error that ended the thread, if one did."""
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self.fd)
        records = [self._records.get_nowait() for _ in range(self._records.qsize())]
        if self._failure and not records:
            raise self._failure
        return records

    def discard_records(self) -> int:
        """Discard the records that wait here and in the bus; return how many. Waits for the thread.

        The bus may be read by one thread only. Its queue, of the driver or of the adapter, may hold more frames than
        the thread has room for.
        """
        self._discarded = 0
        self._emptied = emptied = threading.Event()
        if self._thread.is_alive():
            emptied.wait(self.EMPTY_WITHIN_S)
        self._emptied = None
        return self._discarded + len(self.pop_records())

    def stop(self) -> None:
        """End the thread and close the descriptor."""
        self._stopped.set()
        self._thread.join()
        os.close(self.fd)

    def _run(self) -> None:
        try:
            while not self._stopped.is_set():
                if emptied := self._emptied:
                    self._empty_bus()
                    self._emptied = None
                    emptied.set()
                record = self._next_record(self.PERIOD_S)
                if record:
                    self._store(record)
        except Exception as error:  # noqa: BLE001 - whatever a driver raises
            self._failure = error
            os.eventfd_write(self.fd, 1)

    def _next_record(self, timeout: float) -> bytes | None:
        """Return the next record, b"" for what is not a data frame; None if none comes within `timeout` (s).

        Raises whatever the driver raises when the device is lost.
        """
        try:
            message = self._bus.recv(timeout)
        except Exception as error:
            self._damaged += 1
            if _system_error(error) or self._damaged > self.MOST_DAMAGED:
                raise
            return DAMAGED
        self._damaged = 0
        return _record_of_message(message) if message else None

    def _empty_bus(self) -> None:
        while self._emptied and self._next_record(0.0) is not None:
            self._discarded += 1

    def _store(self, record: bytes) -> None:
        while not (self._stopped.is_set() or self._emptied):
            try:
                self._records.put(record, timeout=self.PERIOD_S)
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
    if interface not in can.VALID_INTERFACES:
        raise DeviceError(f"{name}: python-can has no such interface; it has {', '.join(sorted(can.VALID_INTERFACES))}")
    try:
        return can.Bus(channel, interface, ignore_config=True, bitrate=bitrate)
    except Exception as error:  # noqa: BLE001 - whatever a driver raises
        raise _opening_error(name, interface, error) from None


def _opening_error(name: str, interface: str, error: Exception) -> HilError:
    """Return the error for a driver that did not open; without the manufacturer's library some fail with NameError."""
    from can import CanInterfaceNotImplementedError

    if isinstance(error, CanInterfaceNotImplementedError | ImportError | NameError | AttributeError):
        return MissingExtraError(
            f"{name}: {_first_line(error)}; install the driver of this adapter: python-can's page about {interface!r} "
            "says which"
        )
    cause = _system_error(error)
    if cause and cause.errno in (errno.ENETUNREACH, errno.EADDRNOTAVAIL):
        return DeviceError(f"{name}: {_first_line(error)}; check the network: ip route")
    return DeviceError(f"{name}: {_first_line(error)}; check the channel, and that its adapter is plugged in")


def _system_error(error: Exception) -> OSError | None:
    """Return the system's error behind a driver's, which means a lost device; None if there is none."""
    return next((one for one in (error, error.__cause__) if isinstance(one, OSError)), None)


def _first_line(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]


def _record_of_message(message: "Message") -> bytes:
    """Return the record of a classic data frame; b"" for another kind, `DAMAGED` for one that cannot be."""
    if message.is_remote_frame or message.is_error_frame or message.is_fd:
        return b""
    if message.arbitration_id > (ID_MASK if message.is_extended_id else 0x7FF) or len(message.data) > MAX_DATA:
        return DAMAGED
    return pack_frame(CanFrame(message.arbitration_id, bytes(message.data), message.is_extended_id))
