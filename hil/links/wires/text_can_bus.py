"""CAN buses behind a stream of text, one line or element for each frame, see `hil.links.wires.can_bus`.

SlcanWire         an adapter with the Lawicel text protocol, on any wire of bytes, usually a serial device
SocketcandWire    a bus of another machine that runs socketcand (github.com/linux-can/socketcand), over TCP
"""

import contextlib
from abc import abstractmethod
from binascii import Error as HexError
from binascii import unhexlify

from hil.common.errors import ConfigError, DeviceError
from hil.links.contract import Wire
from hil.links.wires.can_bus import BITRATE
from hil.links.wires.can_frame import MAX_DATA, RECORD_SIZE, CanFrame, pack_frame, unpack_frames


class TextCanWire(Wire):
    """Frames as text on `line`, a wire of bytes that it then owns.

    It sends `opening` first, and `closing` when it is closed. The answers are ignored, as adapters differ in them.
    Raises DeviceError if the line is lost.
    """

    record_size = RECORD_SIZE
    END: bytes  # of each frame
    LONGEST = 64  # characters of a frame, and a margin: what is longer is noise

    def __init__(self, line: Wire, name: str, opening: bytes, closing: bytes = b"") -> None:
        self.name = name
        self._line = line
        self._unread = b""  # start of an incomplete frame
        self._unsent = opening
        self._closing = closing
        self._flush()

    def fileno(self) -> int:
        """Return the line's descriptor."""
        return self._line.fileno()

    def read(self) -> bytes:
        """Return the received frames, or b"". Raises DeviceError if the line is lost."""
        self._flush()
        *texts, self._unread = self._split(self._unread + self._line.read())
        self._unread = self._unread[-self.LONGEST :]
        frames = [self._frame_of(text) for text in texts]
        return b"".join([pack_frame(frame) for frame in frames if frame])

    def discard_received(self) -> int:
        """Discard the received text; return the number of its characters."""
        self._unread = b""
        return self._line.discard_received()

    def write(self, data: bytes) -> int:
        """Send whole records; return the bytes that the line accepted. Raises DeviceError when it is lost."""
        for start in range(0, len(data), RECORD_SIZE):
            for frame in unpack_frames(data[start : start + RECORD_SIZE]):
                if not self._flush():
                    return start
                self._unsent = self._text_of(frame)
        self._flush()
        return len(data)

    def unsent(self) -> int:
        """Return the number of characters that wait here or in the line."""
        return len(self._unsent) + self._line.unsent()

    def discard_unsent(self) -> None:
        """Discard what the line has not sent; send an end of frame first, as a frame may have been cut."""
        self._line.discard_unsent()
        self._unsent = self.END

    def close(self) -> None:
        """Close the bus and the line. May be called twice."""
        with contextlib.suppress(DeviceError):
            self._line.write(self._closing)
        self._line.close()

    def _split(self, text: bytes) -> list[bytes]:
        return text.split(self.END)

    @abstractmethod
    def _text_of(self, frame: CanFrame) -> bytes:
        """Return the text that sends `frame`."""

    @abstractmethod
    def _frame_of(self, text: bytes) -> CanFrame | None:
        """Return the frame of a received text without its end; None for an answer or noise."""

    def _flush(self) -> bool:
        """Send the rest of a text that the wire has cut; return whether all is sent."""
        taken = self._line.write(self._unsent) if self._unsent else 0
        self._unsent = self._unsent[taken:]
        return not self._unsent


class SlcanWire(TextCanWire):
    """A CAN adapter with the Lawicel text protocol ("slcan"): it is closed, configured and opened.

    bitrate: of the bus, bit/s, one of `BITRATES`. Raises ConfigError for another one.
    """

    END = b"\r"
    BITRATES = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)  # S0 to S8

    def __init__(self, line: Wire, bitrate: int = BITRATE) -> None:
        name = f"can:slcan:{line.name}"
        if bitrate not in self.BITRATES:
            line.close()
            raise ConfigError(f"{name}: {bitrate} bit/s is not one of {', '.join(map(str, self.BITRATES))}")
        super().__init__(line, name, b"\rC\rS%d\rO\r" % self.BITRATES.index(bitrate), b"\rC\r")

    def _split(self, text: bytes) -> list[bytes]:
        return super()._split(text.replace(b"\a", b"\r"))  # BEL is the answer to a refused command

    def _text_of(self, frame: CanFrame) -> bytes:
        mark, digits = ("T", 8) if frame.extended else ("t", 3)
        return f"{mark}{frame.id:0{digits}X}{len(frame.data)}{frame.data.hex().upper()}\r".encode()

    def _frame_of(self, text: bytes) -> CanFrame | None:
        mark = text[:1]
        if mark not in (b"t", b"T"):
            return None
        digits = 9 if mark == b"T" else 4
        size = text[digits : digits + 1]
        if not size.isdigit():
            return None
        return _frame(text[1:digits], text[digits + 1 : digits + 1 + 2 * int(size)], int(size), mark == b"T")


class SocketcandWire(TextCanWire):
    """The bus `channel` of a socketcand server, in its raw mode, on `line`, a connection to that server."""

    END = b">"

    def __init__(self, line: Wire, channel: str) -> None:
        super().__init__(
            line,
            f"can:socketcand:{line.name.removeprefix('tcp://')}/{channel}",
            f"< open {channel} >< rawmode >".encode(),
        )

    def _text_of(self, frame: CanFrame) -> bytes:
        digits = 8 if frame.extended else 3
        return f"< send {frame.id:0{digits}X} {len(frame.data)} {frame.data.hex(' ').upper()} >".encode()

    def _frame_of(self, text: bytes) -> CanFrame | None:
        words = text.rpartition(b"<")[2].split()  # frame IDENTIFIER TIME DATA
        if len(words) not in (3, 4) or words[0] != b"frame":
            return None
        data = words[3] if len(words) == 4 else b""
        return _frame(words[1], data, len(data) // 2, len(words[1]) > 3)


def _frame(identifier: bytes, data: bytes, size: int, extended: bool) -> CanFrame | None:
    """Return the frame of these hexadecimal digits; None if they are not one."""
    try:
        number, content = int(identifier, 16), unhexlify(data)
    except (ValueError, HexError):
        return None
    valid = len(content) == size <= MAX_DATA and 0 <= number < 1 << (29 if extended else 11)
    return CanFrame(number, content, extended) if valid else None
