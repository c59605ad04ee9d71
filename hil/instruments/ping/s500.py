"""Cerulean S500, an echo sounder: all messages of the ping protocol, over UDP, TCP and serial.

Sources: the definitions of s500 in github.com/bluerobotics/ping-protocol, and docs.ceruleansonar.com (programming API,
port 51200, 1024 results a ping, 500 kHz). Gains, bandwidth of a chirp and sampling rate are our choice.
"""

from collections import deque
from math import isnan, log
from typing import Annotated, Any, NamedTuple

from hil.common.clock import NEVER_NS
from hil.common.schema import Range
from hil.instruments.contract import Client, Facts, Scene, Send
from hil.instruments.ping.protocol import Byte, message
from hil.instruments.ping.sounding import EchoSounder, Sounding, Window, adapted_gain, adapted_range

_DISTANCE, _PROFILE = 1223, 1308
_RESULTS, _REACH, _GAINS = 1024, 150.0, 14
_SHORTEST_MM = 500  # of a range; our choice
_DB_A_GAIN = 3.0
_GAIN_OF_MODEL = 4  # with which the echoes are those of the simulated sensor's defaults
_LOWEST_DB = -68.7  # of the strength 1 of 255, with the contrast of the simulated sonars
_HZ, _CHIRP_HZ, _SAMPLING_HZ = 500_000, 50_000, 1_000_000
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
    at = ("udp:127.0.0.1:51200",)
    frequency = float(_HZ)
    readable = {  # noqa: RUF012
        1200: message("fw_version", "device_type:B device_model:B version_major:H version_minor:H"),
        1203: message("speed_of_sound", "sos_mm_per_sec:I"),
        1204: message("range", "start_mm:I used_length_mm:I"),
        1206: message("ping_rate_msec", "interval:H"),
        1207: message("gain_index", "used_gain:I"),
        1211: message("altitude", "distance:I confidence:B"),
        1213: message("processor_degC", "centi_degC:I"),
        _DISTANCE: message("distance2", "distance:I mean:I reserved:H confidence:B mean_confidence:B timestamp:I"),
        _PROFILE: message(
            "profile6_t",
            "ping_number:I start_mm:I used_length_mm:I start_hz:I end_hz:I adc_hz:I timestamp:I spare:I pulse:f "
            "analog_gain:f max_db:f min_db:f depth:f mean_depth:f spare:f confidence:B used_gain:B decimation:B "
            "mean_confidence:B num_results:H",
            has_data=True,
        ),
    }
    commands = {  # noqa: RUF012
        1002: message("set_speed_of_sound", "sos_mm_per_sec:I"),
        1015: message(
            "set_ping_params",
            "start_mm:I length_mm:I gain_index:h msec_per_ping:h pulse_len_usec:H report_id:H reserved:H chirp:B "
            "decimation:B",
        ),
    }
    limits = {  # noqa: RUF012
        "sos_mm_per_sec": (1_000_000, 2_000_000), "start_mm": (0, 100_000), "length_mm": (0, 150_000),
        "gain_index": (-1, _GAINS - 1), "msec_per_ping": (-1, 32_767), "chirp": (0, 1),
    }  # fmt: skip

    def __init__(self, settings: Any, facts: Facts, scene: Scene, send: Send) -> None:
        super().__init__(settings, facts, scene, send)
        major, minor = settings.firmware
        fields = [field for layout in self.readable.values() for field in layout.fields]
        self.values = dict.fromkeys(fields, 0) | self.values | {
            "version_major": major, "version_minor": minor, "sos_mm_per_sec": 1_500_000, "used_length_mm": 10_000,
            "used_gain": _GAIN_OF_MODEL, "centi_degC": round(100 * settings.temperature), "adc_hz": _SAMPLING_HZ,
            "min_db": _LOWEST_DB, "interval": 100, "length_mm": 0, "gain_index": -1, "msec_per_ping": 100,
            "report_id": 0, "chirp": 0,
        }  # fmt: skip
        self._last: deque[tuple[int, int]] = deque(maxlen=20)  # distance and confidence of pings
        self._results = b""
        self._host: Client | None = None
        self._began_ns = 0

    def start(self, now_ns: int) -> None:
        """Wait for a client's parameters."""
        self._began_ns = now_ns

    def request(self, client: Client, number: int, now_ns: int) -> str:
        """Send a message that was requested, with the newest measurement."""
        self.send_message(number, client, self._results)
        return ""

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
            self._host, self.next_ns = client, now_ns
        self.values |= fields
        return ""

    def interval_ns(self) -> int:
        """Return the interval; a single ping, or none, is followed by none."""
        is_repeated = self.values["report_id"] and self.values["msec_per_ping"] >= 0
        return int(self.values["interval"]) * _MS if is_repeated else NEVER_NS

    def window(self) -> Window | None:
        """Return what the parameters say; None while nothing is to be reported."""
        values = self.values
        gain = 12.0 + _DB_A_GAIN * (values["used_gain"] - _GAIN_OF_MODEL)
        start, length, speed = [values[name] / 1000.0 for name in ("start_mm", "used_length_mm", "sos_mm_per_sec")]
        return Window(start, length, _RESULTS, gain, speed) if values["report_id"] else None

    def report(self, window: Window, sounding: Sounding, at_ns: int) -> None:
        """Send a ping."""
        values, end = self.values, window.start + window.length
        distance = end if isnan(sounding.distance) else sounding.distance
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
        self._results = b"".join(level.to_bytes(2, "little") for level in levels)
        self.send_message(values["report_id"] or _DISTANCE, self._host, self._results, measured_ns=at_ns)
        if not values["length_mm"]:
            values |= {"start_mm": 0, "used_length_mm": round(1000.0 * adapted_range(sounding, end, _REACH))}
        if values["gain_index"] < 0:
            values["used_gain"] = adapted_gain(sounding, values["used_gain"], _GAINS - 1)
