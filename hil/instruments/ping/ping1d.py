"""Blue Robotics Ping1D and Ping2, echo sounders: all messages of the ping protocol, over UDP and serial.

Sources: the definitions of ping1d in github.com/bluerobotics/ping-protocol; values at power on from ping-viewer
(src/sensor/ping.cpp); no range or gain is taken in automatic mode, from ping-cpp (test/test-device-ping1d.cpp).
"""

from math import isnan, log10
from typing import Annotated, Any, NamedTuple

from hil.common.clock import NEVER_NS
from hil.common.schema import Range
from hil.instruments.contract import Client, Facts, Scene, Send
from hil.instruments.ping.protocol import Byte, message
from hil.instruments.ping.sounding import EchoSounder, Sounding, Window, adapted_gain, adapted_range

_MEASUREMENTS = DISTANCE_SIMPLE, DISTANCE, PROFILE = 1211, 1212, 1300
_GAINS = (0.6, 1.8, 5.5, 12.9, 30.2, 66.1, 144.0)  # by the number of the gain
_GAIN_OF_MODEL = 12.9  # with which the echoes are those of the simulated sensor's defaults; our choice
_REACH_MM = 100_000
_PULSE = 15.0  # us for each m of the range; our choice
_MS = 1_000_000
_MEASURED = "distance:I confidence:H transmit_duration:H ping_number:I scan_start:I scan_length:I gain_setting:I"


class Ping1DSettings(NamedTuple):
    """Firmware of the device, as it reports it, its supply (V) and the warmth of its board (°C)."""

    firmware: tuple[Byte, Byte, Byte] = (3, 29, 0)
    supply: Annotated[float, Range(0.0, 30.0, "V")] = 5.0
    board_temperature: Annotated[float, Range(0.0, 100.0, "°C")] = 30.0


class Ping1D(EchoSounder):
    """A Ping1D at the place of a simulated echo sounder: it measures itself, at its ping interval or slower.

    Range, gain, speed of sound, interval and profile are the client's. In automatic mode it keeps the bottom at about
    two thirds of the range and the echo below the upper limit; how the device does so is not public. `distance_simple`
    and `distance` can be streamed too, as ArduPilot asks for. The confidence is the contrast of the bottom's echo.
    """

    Model = Ping1DSettings
    at = ("udp:127.0.0.1:9090",)
    revision = 1
    frequency = 115e3
    readable = {  # noqa: RUF012
        1200: message(
            "firmware_version",
            "device_type:B device_model:B firmware_version_major:H firmware_version_minor:H",
        ),
        1201: message("device_id", "device_id:B"),
        1202: message("voltage_5", "voltage_5:H"),
        1203: message("speed_of_sound", "speed_of_sound:I"),
        1204: message("range", "scan_start:I scan_length:I"),
        1205: message("mode_auto", "mode_auto:B"),
        1206: message("ping_interval", "ping_interval:H"),
        1207: message("gain_setting", "gain_setting:I"),
        1208: message("transmit_duration", "transmit_duration:H"),
        1210: message(
            "general_info",
            "firmware_version_major:H firmware_version_minor:H voltage_5:H ping_interval:H gain_setting:B mode_auto:B",
        ),
        DISTANCE_SIMPLE: message("distance_simple", "distance:I confidence:B"),
        DISTANCE: message("distance", _MEASURED),
        1213: message("processor_temperature", "processor_temperature:H"),
        1214: message("pcb_temperature", "pcb_temperature:H"),
        1215: message("ping_enable", "ping_enabled:B"),
        PROFILE: message("profile", f"{_MEASURED} profile_data_length:H", has_data=True),
        1301: message("oss_profile_configuration", "number_of_points:H normalization_enabled:B enhance_enabled:B"),
    }
    commands = {  # noqa: RUF012
        1000: message("set_device_id", "device_id:B"),
        1001: message("set_range", "scan_start:I scan_length:I"),
        1002: message("set_speed_of_sound", "speed_of_sound:I"),
        1003: message("set_mode_auto", "mode_auto:B"),
        1004: message("set_ping_interval", "ping_interval:H"),
        1005: message("set_gain_setting", "gain_setting:B"),
        1006: message("set_ping_enable", "ping_enabled:B"),
        1007: message("set_oss_profile_configuration", "number_of_points:H normalization_enabled:B enhance_enabled:B"),
        1100: message("goto_bootloader"),
        1400: message("continuous_start", "id:H"),
        1401: message("continuous_stop", "id:H"),
    }
    limits = {  # noqa: RUF012
        "device_id": (0, 254), "scan_start": (0, _REACH_MM), "scan_length": (1000, _REACH_MM), "gain_setting": (0, 6),
        "speed_of_sound": (1_000_000, 2_000_000), "mode_auto": (0, 1), "ping_enabled": (0, 1),
        "number_of_points": (1, 4000), "normalization_enabled": (0, 1), "enhance_enabled": (0, 1),
    }  # fmt: skip

    def __init__(self, settings: Any, facts: Facts, scene: Scene, send: Send) -> None:
        super().__init__(settings, facts, scene, send)
        warmth = round(100 * settings.board_temperature)
        self.values |= {
            "device_revision": self.revision, "voltage_5": round(1000 * settings.supply), "pcb_temperature": warmth,
            "processor_temperature": warmth, "speed_of_sound": 1_500_000, "scan_start": 0, "scan_length": 10_000,
            "mode_auto": 1, "ping_interval": 250, "gain_setting": 1, "ping_enabled": 1, "transmit_duration": 0,
            "distance": 0, "confidence": 0, "ping_number": 0, "profile_data_length": 0, "number_of_points": 200,
            "normalization_enabled": 0, "enhance_enabled": 0,
        }  # fmt: skip
        self._profile, self._measured = b"", dict(self.values)
        self._streams: dict[Client, set[int]] = {}
        self._in_bootloader = False

    def disconnected(self, client: Client, now_ns: int) -> None:
        """Forget a client and what it started."""
        super().disconnected(client, now_ns)
        self._streams.pop(client, None)

    def on_data(self, client: Client, data: bytes, now_ns: int) -> None:
        """Answer requests, and execute commands; not in the bootloader."""
        if not self._in_bootloader:
            super().on_data(client, data, now_ns)

    def request(self, client: Client, number: int, now_ns: int) -> str:
        """Send a message that was requested, with the newest measurement."""
        values = self._measured if number in _MEASUREMENTS else None
        self.send_message(number, client, self._profile, values)
        return ""

    def execute(self, client: Client, name: str, fields: dict[str, Any], now_ns: int) -> str:
        """Execute a command; return why not, or ""."""
        if name == "goto_bootloader":
            self._in_bootloader = True
        elif name in ("set_range", "set_gain_setting") and self.values["mode_auto"]:
            return "automatic mode"
        elif name in ("continuous_start", "continuous_stop"):
            if fields["id"] not in _MEASUREMENTS:
                return "cannot stream this message"
            streams = self._streams.setdefault(client, set())
            (streams.add if name == "continuous_start" else streams.discard)(fields["id"])
        else:
            self.values.update(fields)
        return ""

    def interval_ns(self) -> int:
        """Return the ping interval."""
        return NEVER_NS if self._in_bootloader else int(self.values["ping_interval"]) * _MS

    def window(self) -> Window | None:
        """Return what the settings say; None while pinging is disabled."""
        values = self.values
        gain = 12.0 + 20.0 * log10(_GAINS[values["gain_setting"]] / _GAIN_OF_MODEL)
        start, length, speed = [values[name] / 1000.0 for name in ("scan_start", "scan_length", "speed_of_sound")]
        is_on = values["ping_enabled"] and not self._in_bootloader
        return Window(start, length, values["number_of_points"], gain, speed) if is_on else None

    def report(self, window: Window, sounding: Sounding, at_ns: int) -> None:
        """Keep a ping for those who ask, and send it to those who stream."""
        profile, values = sounding.profile, self.values
        end = window.start + window.length
        values["transmit_duration"] = round(_PULSE * end)
        values["ping_number"] += 1
        values["confidence"] = sounding.confidence
        values["distance"] = round(1000.0 * (end if isnan(sounding.distance) else sounding.distance))
        if values["normalization_enabled"] and (peak := max(profile)):
            profile = bytes(x * 255 // peak for x in profile)
        if values["enhance_enabled"]:
            profile = bytes(x * x // 255 for x in profile)
        values["profile_data_length"] = len(profile)
        self._profile, self._measured = profile, dict(values)
        for client, numbers in self._streams.items():
            for number in numbers:
                self.send_message(number, client, profile, self._measured, at_ns)
        if values["mode_auto"]:
            length = round(1000.0 * adapted_range(sounding, end, _REACH_MM / 1000.0))
            gain = adapted_gain(sounding, values["gain_setting"], len(_GAINS) - 1)
            values |= {"scan_start": 0, "scan_length": length, "gain_setting": gain}


class Ping2(Ping1D):
    """A Ping2. It differs from a [Ping1D](#ping1d) by its hardware's number only."""

    revision = 2
