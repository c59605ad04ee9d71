"""A Keller PAA-33X, an absolute pressure transmitter, on Keller's bus and MODBUS RTU, which share one RS-485 line.

Source: Keller, "Description of the communication protocol for series 30, 33X ..." (class 5, group 20). Answers come to
requests only; pressure in bar, temperature in °C, numbers big endian.
"""

from collections.abc import Iterator
from struct import pack, unpack
from typing import Annotated, NamedTuple

from hil.client.client import Stamped
from hil.common.clock import NS_PER_MS
from hil.common.schema import Range
from hil.instruments.contract import Client, Instrument, Reader
from hil.links.frame.checksums import CRCS, crc_checksum

_CRC = crc_checksum(CRCS["crc16-modbus"])
_TRANSPARENT = 250  # every device answers to it
_MODBUS = _READ, _READ_INPUT, _ECHO = 3, 4, 8  # whose CRC comes with its low byte first
_COEFFICIENT, _SET_COEFFICIENT, _INITIALISE, _ADDRESS, _SERIAL, _VALUE, _INTEGER, _ZERO = 30, 31, 48, 66, 69, 73, 74, 95
_SIZES = {
    _READ: 8, _READ_INPUT: 8, _ECHO: 8, _COEFFICIENT: 5, _SET_COEFFICIENT: 9, _INITIALISE: 4, _ADDRESS: 5, _SERIAL: 4,
    _VALUE: 5, _INTEGER: 5, _ZERO: 5,
}  # fmt: skip
_NO_FUNCTION, _NO_ADDRESS, _BAD_VALUE, _NOT_INITIALISED = 1, 2, 3, 32
_PRESSURE, _TEMPERATURE = 1, 4  # channels
_OFFSET, _GAIN, _LOWEST, _HIGHEST = 64, 65, 80, 81  # coefficients
_LARGEST = 1e3  # of a coefficient
_SILENCE_NS = 50 * NS_PER_MS  # after which a new request begins


class KellerSettings(NamedTuple):
    """Address on the bus, `highest` pressure (bar), temperature (°C) of the water, and the adapter's `echo`.

    With `echo` a client reads back what it sends, as with most adapters for two wires.
    """

    address: Annotated[int, Range(1, 249)] = 1
    highest: Annotated[float, Range(1.0, 1000.0, "bar")] = 30.0
    temperature: Annotated[float, Range(-10.0, 80.0, "°C")] = 10.0
    echo: bool = False


class Requests:
    """The requests of a client, by the sizes of their functions; after a silence a new one begins."""

    def __init__(self) -> None:
        self._buffer, self._last_ns = b"", 0
        self.malformed = 0

    def read(self, data: bytes, now_ns: int = 0) -> Iterator[bytes]:
        """Yield each request that is complete."""
        if self._buffer and now_ns - self._last_ns > _SILENCE_NS:
            self._buffer, self.malformed = b"", self.malformed + 1
        self._buffer, self._last_ns = self._buffer + data, now_ns
        while len(self._buffer) >= 2 and len(self._buffer) >= (size := _size(self._buffer)):
            request, self._buffer = self._buffer[:size], self._buffer[size:]
            if request[-2:] == _checksum(request[:-2]):
                yield request
            else:
                self._buffer, self.malformed = b"", self.malformed + 1


class Keller33X(Instrument):
    """The transmitter. Its zero, gain, offset and address can be set, and are kept.

    A request reads the last sample. The device measures 400 times a second, so give the sensor a high rate.
    """

    Model = KellerSettings
    sensors = ("pressure",)
    baud = 9600
    warm_up_s = 0.25

    def prepare(self) -> None:
        """Set its state at power on."""
        self._kept = self.facts.memory
        self._kept.setdefault("address", self.settings.address)
        self._coefficients: dict[int, float] = self._kept.setdefault("coefficients", {_OFFSET: 0.0, _GAIN: 1.0})
        self._is_initialised = False
        self._bar: float | None = None
        self._measured_ns = 0

    def on_sample(self, topic: str, stamped: Stamped, now_ns: int) -> None:
        """Take the pressure that the next request reads."""
        self._bar, self._measured_ns = stamped.value.pascal / 1e5, stamped.sent_ns

    def new_reader(self, client: Client) -> Reader:
        """Return the reader of a client."""
        return Requests()

    def on_data(self, client: Client, data: bytes, now_ns: int) -> None:
        """Answer a request when it is complete."""
        if self.settings.echo:
            self.send(data, client)
        super().on_data(client, data, now_ns)

    def on_message(self, client: Client, message: bytes, now_ns: int) -> None:
        """Answer a request to this device."""
        if message[0] in (self._kept["address"], _TRANSPARENT):
            self._answer(client, message)

    def _answer(self, client: Client, request: bytes) -> None:
        function, content = request[1], request[2:-2]
        result: bytes | int = _NOT_INITIALISED
        if self._is_initialised or function in (_INITIALISE, *_MODBUS):
            result = self._execute(function, content)
        if isinstance(result, int):
            function, result = function | 0x80, bytes((result,))
        body = bytes((request[0], function)) + result
        self.send(body + _checksum(body), client, measured_ns=self._measured_ns)

    def _execute(self, function: int, content: bytes) -> bytes | int:
        """Return the content of an answer, or the number of an exception."""
        if function == _ECHO:
            return content
        if function in _MODBUS:
            start, count = unpack(">HH", content)
            values = [self._channel(register // 2) for register in range(start, start + min(count, 12), 2)]
            if start % 2 or not 0 < count <= 12 or count % 2 or None in values:
                return _NO_ADDRESS
            return pack(f">B{len(values)}f", 2 * count, *values)
        if function == _INITIALISE:
            was, self._is_initialised = self._is_initialised, True
            return bytes((5, 20, 12, 28, 10, int(not was)))
        if function == _SERIAL:
            return pack(">I", 330_000 + self._kept["address"])
        if function == _ADDRESS:
            self._kept["address"] = content[0] if 0 < content[0] < _TRANSPARENT else self._kept["address"]
            return bytes((self._kept["address"],))
        if function in (_VALUE, _INTEGER, _COEFFICIENT):
            coefficients = self._coefficients | {_LOWEST: 0.0, _HIGHEST: self.settings.highest}
            value = self._channel(content[0]) if function != _COEFFICIENT else coefficients.get(content[0])
            if value is None:
                return _NO_ADDRESS
            whole = max(-(1 << 31), min((1 << 31) - 1, round(value * 1e5)))
            data = pack(">i", whole) if function == _INTEGER else pack(">f", value)
            return data if function == _COEFFICIENT else data + b"\0"  # the state
        return self._configure(function, content)

    def _configure(self, function: int, content: bytes) -> bytes | int:
        """Set a coefficient, or the zero: to a pressure that is given, or as delivered."""
        if function not in (_SET_COEFFICIENT, _ZERO):
            return _NO_FUNCTION
        name, value = content[0], unpack(">f", content[1:])[0] if len(content) > 1 else 0.0
        if name not in ((0, 1) if function == _ZERO else self._coefficients):
            return _NO_ADDRESS
        if not abs(value) < _LARGEST:
            return _BAD_VALUE
        if function == _ZERO:
            here = self._coefficients[_OFFSET] + value - (self._channel(_PRESSURE) or 0.0)
            name, value = _OFFSET, 0.0 if name else here
        self._coefficients[name] = value
        return b"\0"

    def _channel(self, channel: int) -> float | None:
        """Return the value of a channel; None if there is no such."""
        if channel == _PRESSURE and self._bar is not None:
            bar: float = min(self._bar, 1.1 * self.settings.highest)  # where the amplifier saturates
            return bar * self._coefficients[_GAIN] + self._coefficients[_OFFSET]
        return float(self.settings.temperature) if channel == _TEMPERATURE else None


def _checksum(body: bytes) -> bytes:
    order = "<H" if body[1] & 0x7F in _MODBUS else ">H"
    return pack(order, _CRC.of(body))


def _size(request: bytes) -> int:
    """Return the size of a request; a zero may have a value with it, and an unknown function is as short as any."""
    return 9 if request[1] == _ZERO and len(request) >= 9 else _SIZES.get(request[1], 4)
