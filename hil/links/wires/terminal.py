"""Wires on this machine: pseudo terminals and serial devices.

    PtyWire      the STM32's end of a pseudo terminal; any program opens the other end by its path
    PtyHostWire  the host's end of such a pty, without pyserial: for a controller of our own
    UartWire     either end of a real serial device, or of a pty, through pyserial

None of them blocks, and none distinguishes noise from data: they transport bytes.
"""

import contextlib
import errno
import fcntl
import os
import select
import struct
import termios
import tty

from hil.common.errors import DeviceError, MissingExtraError
from hil.links.contract import Wire, count_read
from hil.links.wires.pty_name import PtyName

READ_SIZE = 4096  # size of a terminal's input buffer, and so the most that one read can return
UNREAD_LIMIT = 2048  # unread bytes; with 32 bytes every 20 ms this is 1.3 s of telemetry
TCGETS2 = 0x802C542A  # asm-generic/ioctls.h: termios with the speed as a number, for non-standard speeds
TERMIOS2_OSPEED = 40  # byte offset in struct termios2, asm-generic/termbits.h

REMEDIES = {
    errno.ENOENT: "no such device",
    errno.EACCES: "permission denied; add this user to its group: sudo usermod -aG dialout $USER, then log in again",
    errno.EAGAIN: "already in use by another process; end that one first (fuser -v names it)",
    errno.EBUSY: "already in use by another process; end that one first (fuser -v names it)",
    errno.ENOTTY: "is not a serial device",
    errno.ENOTDIR: "no such device",
    errno.ENXIO: "the driver knows no such device; is it plugged in?",
    errno.EIO: "no device answers; is it plugged in, and does its other end run?",
}


def queued_bytes(fd: int, request: int) -> int:
    """Return the number of bytes in a queue of `fd`, by an ioctl; 0 if its driver does not support the request."""
    try:
        count: int = struct.unpack("i", fcntl.ioctl(fd, request, bytes(4)))[0]
    except (OSError, ValueError):  # a lost or closed device is reported by the next read or write
        return 0
    return count


class DescriptorWire(Wire):
    """A wire on one non-blocking file descriptor, which it owns."""

    def __init__(self, fd: int, name: str) -> None:
        self._fd = fd
        self.name = name

    def fileno(self) -> int:
        """Return the descriptor to wait on for incoming bytes; -1 once closed."""
        return self._fd

    def read(self) -> bytes:
        """Return the received bytes (4096 at most), or b"". Raises DeviceError if the device is lost."""
        try:
            data = os.read(self._fd, READ_SIZE)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._lost_error(error.strerror) from None
        if not data:  # in raw mode only a hang-up reads as b""
            raise self._lost_error("the other end closed")
        return data

    def write(self, data: bytes) -> int:
        """Send `data`; return the number of bytes accepted. Raises DeviceError if the device is lost."""
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise self._lost_error(error.strerror) from None

    def close(self) -> None:
        """Close the device. May be called twice."""
        fd, self._fd = self._fd, -1
        if fd >= 0:
            os.close(fd)

    def _lost_error(self, reason: str | None) -> DeviceError:
        if self._fd < 0:
            return DeviceError(f"{self.name}: is closed; open it again")
        return DeviceError(f"{self.name}: went away ({reason}); reconnect it")


class TerminalWire(DescriptorWire):
    """A wire on a terminal; none of its methods waits for the kernel.

    A kernel thread of normal priority moves the bytes from the driver, or from the other end of a pty, to the reader. A
    `read` or `select` that finds nothing waits until that thread has run, which made a real-time loop 0.1 s late on a
    busy machine. So `fileno` is an edge-triggered epoll, which wakes once that thread has delivered bytes, and `read`
    reads the terminal only then.
    """

    def __init__(self, fd: int, name: str) -> None:
        super().__init__(fd, name)
        self._arrivals = select.epoll(1)
        self._arrivals.register(fd, select.EPOLLIN | select.EPOLLET)

    def fileno(self) -> int:
        """Return the descriptor to wait on for incoming bytes; -1 once closed."""
        return -1 if self._arrivals.closed else self._arrivals.fileno()

    @property
    def terminal(self) -> int:
        """Descriptor of the terminal itself, for reads of single bytes; -1 once closed."""
        return self._fd

    def read(self) -> bytes:
        """Return the received bytes (4096 at most), or b"". Raises DeviceError if the device is lost."""
        if self._fd >= 0:
            events = self._arrivals.poll(0, 1)
            if not events:
                return b""
            if events[0][1] & ~select.EPOLLIN:  # a hang-up, which each further read has to report too
                self._arrivals.modify(self._fd, select.EPOLLIN)
        return super().read()

    def discard_received(self) -> int:
        """Read the terminal itself: a terminal with more than 4096 bytes delivers the rest after it was read."""
        return count_read(super().read)

    def close(self) -> None:
        """Close the device. May be called twice."""
        self._arrivals.close()
        super().close()


def open_pty() -> tuple[int, int]:
    """Return a new pty: its master, which does not block, and its slave, both raw. Raises DeviceError."""
    try:
        master, slave = os.openpty()
    except OSError as error:
        raise DeviceError(f"pty: {error.strerror}; raise kernel.pty.max or close other terminals") from None
    os.set_blocking(master, False)
    tty.setraw(slave)
    return master, slave


class PtyWire(TerminalWire):
    """Device end (STM32) of a new pseudo terminal; other programs open `path` as if it were a serial port.

    `link_path` is a second name for it that stays the same from run to run, a symbolic link such as
    "/tmp/uuv-hil-stm32". One process at a time can own that name. A link left over by a killed process is replaced; a
    file that is not a link to a pty is never changed.

    This end does not notice when programs open and close the other end. As on a UART, bytes that nobody reads are lost:
    at most about `UNREAD_LIMIT` bytes are stored. So a program that opens the port, and discards waiting bytes as
    pyserial does, never reads old telemetry.

    Raises DeviceError if the name is in use or cannot be made, or no pty is left. Not modelled: transmission time at a
    baud rate, parity, modem lines.
    """

    def __init__(self, link_path: str = "") -> None:
        master, self._slave = open_pty()
        self.path = os.ttyname(self._slave)
        self._second_name: PtyName | None = None
        self._free_bytes = 0  # bytes that can be written before `UNREAD_LIMIT` may be reached
        super().__init__(master, link_path or self.path)
        if link_path:
            try:
                self._second_name = PtyName(link_path, self.path)
            except DeviceError:
                self.close()
                raise

    @property
    def baud(self) -> int:
        """Speed in bit/s that the program at the other end has set (38400 by default)."""
        ospeed: int = struct.unpack_from("I", fcntl.ioctl(self._fd, TCGETS2, bytes(44)), TERMIOS2_OSPEED)[0]
        return ospeed

    def set_baud(self, baud: int) -> None:
        """Set the speed in bit/s that the other end has until a program sets another; not if no standard has it."""
        settings = termios.tcgetattr(self._slave)
        settings[4] = settings[5] = getattr(termios, f"B{baud}", settings[5])
        termios.tcsetattr(self._slave, termios.TCSANOW, settings)

    def write(self, data: bytes) -> int:
        """Send `data`, or nothing if the other end has stopped reading; return the number of bytes accepted."""
        if self._free_bytes <= 0 <= self._fd:
            # The query costs as much as a write, so once for many frames.
            self._free_bytes = UNREAD_LIMIT - self._unread()
            if self._free_bytes <= 0:
                return 0
        self._free_bytes -= len(data)
        return super().write(data)

    def close(self) -> None:
        """Remove the link and the pty. May be called twice."""
        if self._second_name:
            self._second_name.remove()
            self._second_name = None
        if self._fd >= 0:
            os.close(self._slave)
        super().close()

    def _unread(self) -> int:
        return queued_bytes(self._slave, termios.FIONREAD)


class PtyHostWire(TerminalWire):
    """Host end of the pty at `path`, opened exclusively. Bytes that were waiting there are discarded.

    Raises DeviceError if there is no such pty, it is not a terminal, or another program has it open.
    """

    def __init__(self, path: str) -> None:
        try:
            fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            raise _cannot_open(path, error) from None
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)  # the same lock as pyserial's exclusive mode
            tty.setraw(fd)
        except (OSError, termios.error) as error:
            os.close(fd)
            raise _cannot_open(path, error) from None
        super().__init__(fd, path)


class UartWire(TerminalWire):
    """A serial device, or the host's end of a pty: 8 data bits, no parity, 1 stop bit, opened exclusively.

    `device` is its path (prefer /dev/serial/by-id/..., which stays the same), `baud` in bit/s. With `rs485` the driver
    switches the direction of a two-wire bus (RTS high while sending); traffic of other devices on that bus is read
    too. If the driver allows it, bytes are delivered at once (with FTDI adapters after 1 ms instead of 16 ms).
    Raises DeviceError if there is no such device (the error lists those present), this user may not open it, another
    process has it open, or it does not support RS-485; MissingExtraError without pyserial.
    """

    def __init__(self, device: str, baud: int = 115_200, rs485: bool = False) -> None:
        try:
            import serial
        except ImportError:
            raise MissingExtraError("a uart needs pyserial: pip install pyserial") from None
        try:
            self._port = serial.Serial(device, baud, timeout=0, write_timeout=0, exclusive=True)
        except (OSError, termios.error) as error:  # pyserial's SerialException is an OSError
            raise _cannot_open(device, error, _ports() if error.args[0] == errno.ENOENT else "") from None
        except ValueError as error:
            raise DeviceError(f"{device}: cannot run at {baud} bit/s ({error}); choose another baud") from None
        # pyserial opens and configures; reading and writing the descriptor directly takes a third of the time.
        super().__init__(self._port.fileno(), device)
        self.baud = baud
        try:
            self._wait_for_a_byte()
        except termios.error as error:  # the device was removed meanwhile
            self.close()
            raise _cannot_open(device, error) from None
        self._request_low_latency()
        if rs485:
            self._switch_direction()

    def close(self) -> None:
        """Close the device. May be called twice."""
        self._arrivals.close()
        self._fd = -1
        self._port.close()

    def set_baud(self, baud: int) -> None:
        """Change the speed. Raises DeviceError if the device is lost or has no such speed."""
        try:
            self._port.baudrate = self.baud = baud
            self._wait_for_a_byte()
        except (OSError, ValueError, termios.error) as error:
            raise self._lost_error(str(error)) from None

    def _wait_for_a_byte(self) -> None:
        """Set VMIN to 1: with pyserial's 0 a quiet line and a hang-up both read as b"", with 1 only a hang-up does."""
        settings = termios.tcgetattr(self._fd)
        settings[6][termios.VMIN] = 1
        termios.tcsetattr(self._fd, termios.TCSANOW, settings)

    def _switch_direction(self) -> None:
        from serial.rs485 import RS485Settings

        try:
            self._port.rs485_mode = RS485Settings()
        except (OSError, ValueError):  # the driver does not support the request
            self.close()
            raise DeviceError(
                f"{self.name}: its driver has no RS-485 mode; use an adapter that switches direction by itself, "
                f"and name it without rs485:"
            ) from None

    def unsent(self) -> int:
        """Return the bytes in the kernel's queue of this device (TIOCOUTQ), not those in the adapter's memory."""
        return queued_bytes(self._fd, termios.TIOCOUTQ)

    def discard_unsent(self) -> None:
        """Empty the kernel's output queue of this device."""
        with contextlib.suppress(OSError, ValueError, termios.error):  # a lost device is reported by the next write
            termios.tcflush(self._fd, termios.TCOFLUSH)

    def _request_low_latency(self) -> bool:
        try:
            self._port.set_low_latency_mode(True)
        except (OSError, ValueError, NotImplementedError):
            return False  # ptys and many drivers have no such mode
        return True


def _cannot_open(path: str, error: OSError | termios.error, there_are: str = "") -> DeviceError:
    code = error.errno if isinstance(error, OSError) else error.args[0]  # termios.error has no errno
    return DeviceError(f"{path}: {REMEDIES.get(code or 0, str(error))}{there_are}")


def _ports() -> str:
    from serial.tools import list_ports

    names = ", ".join(sorted(port.device for port in list_ports.comports()))
    return f"; serial ports here: {names or 'none'}"
