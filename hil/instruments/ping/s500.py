"""Cerulean S500, an echo sounder: all messages of the ping protocol, over UDP, TCP and serial.

Source: docs.ceruleansonar.com (port 51200, 500 kHz). Gains and bandwidth of a chirp are our choice.
"""

from collections import deque
from math import log
from typing import Annotated, Any, NamedTuple

from hil.common.clock import NEVER_NS
from hil.common.schema import Range
from hil.instruments.contract import Client
from hil.instruments.ping.protocol import Byte
from hil.instruments.ping.sounding import EchoSounder, Sounding

_DISTANCE, _PROFILE = 1223, 1308
_SHORTEST_MM = 500  # of a range; our choice
_DB_A_GAIN, _GAIN_OF_MODEL = 3.0, 4  # with the second the echoes are those of the simulated sensor's defaults
_HZ, _CHIRP_HZ = 500_000, 50_000
_PULSE_S = 15e-6  # for each m of the range
_MS = 1_000_000


class S500Settings(NamedTuple):
    """Firmware of the device, as it reports it, and the temperature of its processor (°C)."""

    firmware: tuple[Byte, Byte] = (2, 2)
    temperature: Annotated[float, Range(0.0, 100.0, "°C")] = 35.0


class S500(EchoSounder):
    """An S500 at the place of a simulated echo sounder. It pings once a client has set what it wants to receive.

    With a length or a gain of "automatic" it chooses them as a [Ping1D](#ping1d) does.
    """

    Model = S500Settings
    table = "s500"
    at = ("udp:127.0.0.1:51200",)
    frequency, reach = float(_HZ), 150.0
    covered, gain = ("start_mm", "used_length_mm", "sos_mm_per_sec"), "used_gain"
    gains = [_DB_A_GAIN * (number - _GAIN_OF_MODEL) for number in range(14)]  # noqa: RUF012

    def prepare(self) -> None:
        """Set its state at power on."""
        super().prepare()
        major, minor = self.settings.firmware
        temperature = round(100 * self.settings.temperature)
        self.values |= {"version_major": major, "version_minor": minor, "centi_degC": temperature}
        self._last: deque[tuple[int, int]] = deque(maxlen=20)  # distance and confidence of pings
        self._host: Client
        self._began_ns = 0

    def start(self, now_ns: int) -> None:
        """Wait for a client's parameters."""
        self._began_ns = now_ns

    def execute(self, client: Client, name: str, fields: dict[str, Any], now_ns: int) -> str:
        """Execute a command; return why not, or ""."""
        if name == "set_ping_params":
            if fields["report_id"] not in (0, _DISTANCE, _PROFILE):
                return "unknown report"
            if 0 < fields["length_mm"] < _SHORTEST_MM:
                return "length_mm out of range"
            fields["interval"] = max(fields["msec_per_ping"], 0)
            if fields["length_mm"]:
                fields["used_length_mm"] = fields["length_mm"]
            if fields["gain_index"] >= 0:
                fields["used_gain"] = fields["gain_index"]
            self._host, self.timers[self.ping] = client, now_ns
        return super().execute(client, name, fields, now_ns)

    def interval_ns(self) -> int:
        """Return the interval; a single ping, or none, is followed by none."""
        is_repeated = self.values["report_id"] and self.values["msec_per_ping"] >= 0
        return int(self.values["interval"]) * _MS if is_repeated else NEVER_NS

    def is_on(self) -> bool:
        """Return whether anything is to be reported."""
        return bool(self.values["report_id"])

    def report(self, end: float, distance: float, sounding: Sounding, at_ns: int) -> None:
        """Send a ping."""
        values = self.values
        self._last.append((round(1000.0 * distance), sounding.confidence))
        mean, sureness = [sum(column) // len(self._last) for column in zip(*self._last, strict=True)]
        bandwidth = _CHIRP_HZ * values["chirp"]
        values |= {
            "ping_number": values["ping_number"] + 1, "distance": self._last[-1][0], "confidence": sounding.confidence,
            "mean": mean, "mean_confidence": sureness, "depth": distance, "mean_depth": mean / 1000.0,
            "timestamp": (at_ns - self._began_ns) // _MS & 0xFFFFFFFF, "pulse": _PULSE_S * end,
            "start_hz": _HZ - bandwidth, "end_hz": _HZ + bandwidth, "num_results": len(sounding.profile),
            "analog_gain": 10.0 ** (0.05 * _DB_A_GAIN * values["used_gain"]),
        }  # fmt: skip
        levels = [round(65_535 * log(max(strength, 1)) / log(255.0)) for strength in sounding.profile]
        self.data = b"".join(level.to_bytes(2, "little") for level in levels)
        self.send_message(values["report_id"] or _DISTANCE, self._host, at_ns)
        self.adapt(end, sounding, not values["length_mm"], values["gain_index"] < 0)
