"""CAN adapters with the Lawicel text protocol ("slcan"), one line for each frame, see `hil.links.wires.can_bus`."""

import contextlib
from binascii import Error as HexError
from binascii import unhexlify

from hil.common.errors import ConfigError, DeviceError
from hil.links.contract import Wire
from hil.links.wires.can_bus import BITRATE
from hil.links.wires.can_frame import MAX_DATA, RECORD_SIZE, CanFrame, pack_frame, unpack_frames


class SlcanWire(Wire):
    """A CAN adapter on `line`, a wire of bytes that it then owns: it is closed, configured and opened.

    bitrate: of the bus, bit/s, one of `BITRATES`. The answers are ignored, as adapters differ in them. Raises
    ConfigError for another bitrate, DeviceError if the line is lost.
    """

    record_size = RECORD_SIZE
    BITRATES = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)  # S0 to S8
    LONGEST = 64  # characters of a frame, and a margin: what is longer is noise

    def __init__(self, line: Wire, bitrate: int = BITRATE) -> None:
        self.name = f"can:slcan:{line.name}"
        self._line = line
        if bitrate not in self.BITRATES:
            line.close()
            raise ConfigError(f"{self.name}: {bitrate} bit/s is not one of {', '.join(map(str, self.BITRATES))}")
        self._unread = b""  # start of an incomplete frame
        self._unsent = b"\rC\rS%d\rO\r" % self.BITRATES.index(bitrate)
        self._flush()

    def fileno(self) -> int:
        """Return the line's descriptor."""
        return self._line.fileno()

    def read(self) -> bytes:
        """Return the received frames, or b"". Raises DeviceError if the line is lost."""
        self._flush()
        text = (self._unread + self._line.read()).replace(b"\a", b"\r")  # BEL is the answer to a refused command
        *lines, self._unread = text.split(b"\r")
        self._unread = self._unread[-self.LONGEST :]
        frames = [_frame_of(line) for line in lines]
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
                mark, digits = ("T", 8) if frame.extended else ("t", 3)
                text = f"{mark}{frame.id:0{digits}X}{len(frame.data)}{frame.data.hex().upper()}\r"
                self._unsent = text.encode()
        self._flush()
        return len(data)

    def unsent(self) -> int:
        """Return the number of characters that wait here or in the line."""
        return len(self._unsent) + self._line.unsent()

    def discard_unsent(self) -> None:
        """Discard what the line has not sent; send an end of frame first, as a frame may have been cut."""
        self._line.discard_unsent()
        self._unsent = b"\r"

    def close(self) -> None:
        """Close the bus and the line. May be called twice."""
        with contextlib.suppress(DeviceError):
            self._line.write(b"\rC\r")
        self._line.close()

    def _flush(self) -> bool:
        """Send the rest of a text that the wire has cut; return whether all is sent."""
        taken = self._line.write(self._unsent) if self._unsent else 0
        self._unsent = self._unsent[taken:]
        return not self._unsent


def _frame_of(line: bytes) -> CanFrame | None:
    """Return the frame of a received line without its end; None for an answer or noise."""
    extended = line[:1] == b"T"
    digits = 9 if extended else 4
    size = line[digits : digits + 1]
    if line[:1] not in (b"t", b"T") or not size.isdigit():
        return None
    try:
        number, data = int(line[1:digits], 16), unhexlify(line[digits + 1 : digits + 1 + 2 * int(size)])
    except (ValueError, HexError):
        return None
    valid = len(data) == int(size) <= MAX_DATA and 0 <= number < 1 << (29 if extended else 11)
    return CanFrame(number, data, extended) if valid else None
