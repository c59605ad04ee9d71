"""A Paroscientific Digiquartz intelligent transmitter: lines of text with addresses, on request or continuously.

Source: Paroscientific, "Digiquartz programming and operation manual for RS-232 and RS-485 instruments". A command is
*ddssCC, to device dd from ss (00 is the computer); an answer has both the other way round.
"""

import re
from typing import Annotated, Any, NamedTuple

from hil.client.client import Stamped
from hil.common.schema import Range
from hil.instruments.contract import Client, Instrument

_COMMAND = re.compile(rb"\*(\d\d)(\d\d)([A-Z]{2}|[A-Z]\d)(?:=([^*\r\n]{1,8}))?")
_ALL = b"99"
# Unit, resolutions and integration times of pressure and temperature, mode; only the first has an effect.
_PARAMETERS = {"UN": 1, "PR": 238, "TR": 952, "PI": 666, "TI": 666, "MD": 0}
_LIMITS = {"UN": range(1, 9), "ID": range(1, 99)}
_NAMES = {"SN": "SN=104537", "VR": "VR=M5.10", "MN": "MN=8CB700"}
# Units by number: psi, hPa, bar, kPa, MPa, inches of mercury, mm of mercury, m of water; in Pa.
_UNITS = {1: 6894.757, 2: 100.0, 3: 1e5, 4: 1e3, 5: 1e6, 6: 3386.389, 7: 133.3224, 8: 9806.65}


class DigiquartzSettings(NamedTuple):
    """Address, and temperature (°C) of the water."""

    address: Annotated[int, Range(1, 98)] = 1
    temperature: Annotated[float, Range(-10.0, 80.0, "°C")] = 10.0


class Digiquartz(Instrument):
    """The transmitter: P3 and Q3 return pressure and temperature, P4 pressure until another command comes.

    A parameter (unit UN, address ID, and PR, TR, PI, TI, MD, which have no effect) is set by XX=value just after EW, on
    the same line or before; it is kept. A request reads the last sample.
    """

    Model = DigiquartzSettings
    sensors = ("pressure",)
    baud = 9600
    first = b"*\r\n"
    warm_up_s = 1.0
    longest = 80

    def prepare(self) -> None:
        """Set its state at power on."""
        self._kept: dict[str, Any] = self.facts.memory
        self._kept |= _PARAMETERS | {"ID": self.settings.address} | self._kept
        self._may_write = self._is_continuous = False
        self._pascal = 0.0
        self._measured_ns = 0

    def on_sample(self, topic: str, stamped: Stamped, now_ns: int) -> None:
        """Take the pressure, and send it while it is asked for continuously."""
        self._pascal, self._measured_ns = stamped.value.pascal, stamped.sent_ns
        if self._is_continuous:
            self._send_pressure()

    def on_message(self, client: Client, message: bytes, now_ns: int) -> None:
        """Carry out the commands of a line; none of a malformed one."""
        commands = list(_COMMAND.finditer(message))
        if b"".join(each[0] for each in commands) != message:
            self.malformed += 1
            return
        for device, _, name, value in (each.groups() for each in commands):
            if device in (_ALL, b"%02d" % self._kept["ID"]):
                self._execute(client, name.decode(), value)

    def _execute(self, client: Client, name: str, value: bytes | None) -> None:
        self._is_continuous = name == "P4"
        may_write, self._may_write = self._may_write, name == "EW"
        if name == "P3" and self._measured_ns:
            self._send_pressure(client)
        elif name == "Q3":
            self.send(self._line(f"{self.settings.temperature:.5g}"), client)
        elif name in _NAMES:
            self.send(self._line(_NAMES[name]), client)
        elif name in self._kept:
            number = int(value) if value and value.isdigit() else -1
            if may_write and number in _LIMITS.get(name, range(65_536)):
                self._kept[name] = number
            self.send(self._line(f"{name}={self._kept[name]}"), client)
        elif name not in ("EW", "P3", "P4"):
            self.malformed += 1

    def _send_pressure(self, client: Client | None = None) -> None:
        text = f"{self._pascal / _UNITS[self._kept['UN']]:.7g}"
        self.send(self._line(text), client, measured_ns=self._measured_ns)

    def _line(self, text: str) -> bytes:
        return b"*00%02d%b\r\n" % (self._kept["ID"], text.encode())
