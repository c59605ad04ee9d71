"""Blue Robotics Ping1D and Ping2, echo sounders: all messages of the ping protocol, over UDP and serial.

No range or gain is taken in automatic mode: ping-cpp (test/test-device-ping1d.cpp).
"""

from math import log10
from typing import Annotated, Any, NamedTuple

from hil.common.clock import NEVER_NS
from hil.common.schema import Range
from hil.instruments.contract import Client
from hil.instruments.ping.protocol import Byte
from hil.instruments.ping.sounding import EchoSounder, Sounding

DISTANCE_SIMPLE, DISTANCE, PROFILE = 1211, 1212, 1300
_GAIN_OF_MODEL = 12.9  # with which the echoes are those of the simulated sensor's defaults; our choice
_PULSE = 15.0  # us for each m of the range; our choice


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
    table = "ping1d"
    at = ("udp:127.0.0.1:9090",)
    revision = 1
    frequency, reach = 115e3, 100.0
    covered, gain = ("scan_start", "scan_length", "speed_of_sound"), "gain_setting"
    gains = [20.0 * log10(x / _GAIN_OF_MODEL) for x in (0.6, 1.8, 5.5, 12.9, 30.2, 66.1, 144.0)]  # noqa: RUF012
    measurements = DISTANCE_SIMPLE, DISTANCE, PROFILE

    def prepare(self) -> None:
        """Set its state at power on."""
        super().prepare()
        warmth = round(100 * self.settings.board_temperature)
        self.values |= {"pcb_temperature": warmth, "processor_temperature": warmth, "device_revision": self.revision}
        self.values["voltage_5"] = round(1000 * self.settings.supply)
        self.measured = dict(self.values)
        self._in_bootloader = False

    def on_data(self, client: Client, data: bytes, now_ns: int) -> None:
        """Answer requests, and execute commands; not in the bootloader."""
        if not self._in_bootloader:
            super().on_data(client, data, now_ns)

    def execute(self, client: Client, name: str, fields: dict[str, Any], now_ns: int) -> str:
        """Execute a command; return why not, or ""."""
        if name == "goto_bootloader":
            self._in_bootloader = True
        elif name in ("set_range", "set_gain_setting") and self.values["mode_auto"]:
            return "automatic mode"
        elif name in ("continuous_start", "continuous_stop"):
            if fields["id"] not in self.measurements:
                return "cannot stream this message"
            streams = self.readers[client].streams
            (streams.add if name == "continuous_start" else streams.discard)(fields["id"])
        else:
            self.values.update(fields)
        return ""

    def interval_ns(self) -> int:
        """Return the ping interval."""
        return NEVER_NS if self._in_bootloader else 1_000_000 * int(self.values["ping_interval"])

    def is_on(self) -> bool:
        """Return whether pinging is enabled."""
        return bool(self.values["ping_enabled"]) and not self._in_bootloader

    def report(self, end: float, distance: float, sounding: Sounding, at_ns: int) -> None:
        """Keep a ping for those who ask, and send it to those who stream."""
        profile, values = sounding.profile, self.values
        if values["normalization_enabled"] and (peak := max(profile)):
            profile = bytes(x * 255 // peak for x in profile)
        if values["enhance_enabled"]:
            profile = bytes(x * x // 255 for x in profile)
        values |= {
            "transmit_duration": round(_PULSE * end), "ping_number": values["ping_number"] + 1,
            "confidence": sounding.confidence, "distance": round(1000.0 * distance),
            "profile_data_length": len(profile),
        }  # fmt: skip
        self.data, self.measured = profile, dict(values)
        for client, reader in self.readers.items():
            for number in reader.streams:
                self.send_message(number, client, at_ns)
        self.adapt(end, sounding, *[bool(values["mode_auto"])] * 2)


class Ping2(Ping1D):
    """A Ping2. It differs from a [Ping1D](#ping1d) by its hardware's number only."""

    revision = 2
