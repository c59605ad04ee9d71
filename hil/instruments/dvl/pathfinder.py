"""A Teledyne RDI Pathfinder 600 kHz: commands at a prompt, and ensembles in the format PD0.

PD0 gives the velocity of the bottom past a DVL at rest: in ship's coordinates a vehicle's way to starboard, ahead and
up is negative.
"""

import re
from collections.abc import Sequence
from datetime import datetime, timezone
from itertools import accumulate
from math import cos, degrees, log10, radians, sin
from struct import pack
from typing import Annotated, Any, NamedTuple

from hil.client.client import Stamped
from hil.common.clock import NS_PER_S
from hil.common.schema import Range
from hil.common.vectors import Quaternion
from hil.instruments.contract import Client, Instrument
from hil.instruments.dvl.formats import millimetres
from hil.instruments.layout import read_device
from sim.rotations import rotate, to_euler
from sim.sensors.samples import DvlSample

NO_VELOCITY = -32_768
_BEAM_ANGLE = 30  # degrees
_BEAM, _EARTH = 0, 3  # coordinates, by the first two digits of EX; 1 and 2 are those of the instrument and the ship
_BANNER = b"\r\nPathfinder\r\nTeledyne RD Instruments (c) 2017\r\nAll rights reserved.\r\nFirmware Version: 67.01\r\n>"
_COMMAND = re.compile(r"#?([A-Z]{2}) ?([-+0-9:.?]*)$")
_SPEEDS = (300, 1200, 2400, 4800, 9600, 19_200, 38_400, 57_600, 115_200)  # bit/s, by the first digit of CB
_BREAK = re.compile(b"===|[+]{3}")
_ACTIONS = ("CK", "CR", "CS", "PA", "PS")


class PathfinderSettings(NamedTuple):
    """Whether it pings from power on (turnkey mode, CT1), and the temperature (°C) of the water."""

    turnkey: bool = False
    temperature: Annotated[float, Range(-5.0, 45.0, "°C")] = 10.0


class Pathfinder(Instrument):
    """The DVL: it waits at its prompt until CS, and pings at the sensor's rate until a break (=== or +++).

    Beam 3 looks ahead, beam 2 to starboard. All four ranges are the sensor's altitude; attitude and depth are the true
    ones. Other formats than PD0, water tracking and profiles are not simulated and are refused.
    """

    Model = PathfinderSettings
    sensors = ("dvl",)
    warm_up_s = 1.0
    longest = 80

    def prepare(self) -> None:
        """Set its state at power on."""
        kept: dict[str, str] = self.facts.memory.setdefault("values", {})
        speed = {"CB": f"{_SPEEDS.index(self.facts.baud)}11"} if self.facts.baud in _SPEEDS else {}
        self._device: dict[str, Any] = read_device("pathfinder")
        self._values = self._device["factory"] | speed | {"CT": str(int(self.settings.turnkey))} | kept
        self._is_pinging = self._values["CT"] == "1"
        self._ensembles = 0

    def start(self, now_ns: int) -> None:
        """Show the prompt, if it does not ping."""
        self._apply_speed()
        if not self._is_pinging:
            self.send(_BANNER)

    def on_data(self, client: Client, data: bytes, now_ns: int) -> None:
        """Carry out commands, echoing them; while it pings only a break is taken."""
        reader = self.readers[client]
        *broken, rest = _BREAK.split(reader.rest + data.upper())
        for text in broken:
            reader.rest = b""
            super().on_data(client, text, now_ns)
            self._is_pinging = False
            self.send(_BANNER)
        reader.rest = b""
        super().on_data(client, rest, now_ns)

    def on_message(self, client: Client, message: bytes, now_ns: int) -> None:
        """Carry out a command."""
        line = message.decode("latin-1").strip()
        if self._is_pinging or not line:
            return
        found = _COMMAND.match(line)
        name, value = found.groups() if found else ("", "")
        answer = ""
        if name in self._values and value == "?":
            answer = f"{name} = {self._values[name]}\r\n"
        elif name in self._values and self._is_valid(name, value):
            self._values[name] = value
        elif name == "CR":
            self._values = dict((value != "1" and self.facts.memory["values"]) or self._device["factory"])
        elif name == "CK":
            self.facts.memory["values"] = dict(self._values)
        elif name not in _ACTIONS:
            answer = f"{line} ERR: Bad command parameters!\r\n"
            self.malformed += 1
        self._is_pinging = name == "CS"
        prompt = "" if self._is_pinging else ">"
        self.send(f"{line}\r\n{answer}{prompt}".encode("latin-1"), client)
        self._apply_speed()

    def _apply_speed(self) -> None:
        self.set_baud(_SPEEDS[int(self._values["CB"][0])])

    def _is_valid(self, name: str, value: str) -> bool:
        lowest, highest = self._device["limits"].get(name, (0, 0))
        is_formed = re.fullmatch(self._device["patterns"].get(name, "[^?]+"), value)
        return bool(is_formed) and (not highest or lowest <= int(value) <= highest)

    def on_sample(self, topic: str, stamped: Stamped, now_ns: int) -> None:
        """Send an ensemble while it pings and its output is on."""
        state, sample = self.scene.state(now_ns), stamped.value
        if not self._is_pinging or state is None or not isinstance(sample, DvlSample):
            return
        self._ensembles += 1
        if self._values["CF"][3] == "0":
            return
        depth, attitude = self.facts.mounting.world_position(state)[2], self.facts.mounting.attitude(state)
        leaders = self._fixed(), self._variable(sample.time_ns, attitude, depth)
        data = ensemble((*leaders, self._bottom(sample, attitude, depth)))
        is_binary = self._values["CF"][2] == "1"
        self.send(data if is_binary else data.hex().upper().encode() + b"\r\n", measured_ns=stamped.sent_ns)

    def _fixed(self) -> bytes:
        """Return the fixed leader: firmware, system, beams, cells, coordinates, sensors, serial number, angle."""
        transformation = int(self._values["EX"], 2)
        return pack(
            "<HBBH2xBxH4xB8xB4x2B18xHBxIB", 0, 67, 1, 0x420B, 4, 1, 1, transformation, 0x7D, 0x3D, 1, 255, 1001,
            _BEAM_ANGLE,
        )  # fmt: skip

    def _variable(self, time_ns: int, attitude: Quaternion, depth: float) -> bytes:
        """Return the variable leader: number, clock, speed of sound, depth, attitude, water, pressure, clock again."""
        roll, pitch, yaw = [degrees(angle) for angle in to_euler(attitude)]
        time = datetime.fromtimestamp(time_ns // NS_PER_S, timezone.utc)
        clock = (*time.timetuple()[1:6], time_ns // 10_000_000 % 100)
        rollover, number = divmod(self._ensembles, 65_536)
        angles = round(100.0 * (yaw % 360.0)) % 36_000, round(100.0 * pitch), round(100.0 * roll)
        water = int(self._values["ES"]), round(100.0 * self.settings.temperature)
        head = pack("<HH7BB2x", 0x80, number, time.year % 100, *clock, rollover & 0xFF)
        head += pack("<HHHhhHh", int(self._values["EC"]), max(0, round(10.0 * depth)), *angles, *water)
        pressure = max(0, round(0.1 * self.facts.pressure(depth)))  # daPa
        return head + pack("<20xI5x8B12x", pressure, *divmod(time.year, 100), *clock)

    def _bottom(self, sample: DvlSample, attitude: Quaternion, depth: float) -> bytes:
        """Return the bottom track: ranges, speeds, and how good they are, of each beam."""
        scale = int(self._values["EC"]) / self.facts.sound_speed(depth)  # by the speed of sound that it assumes
        reach = int(self._values["BX"])  # dm
        is_locked = sample.locked and sample.altitude <= 0.1 * reach
        distance, speeds, strength = 0, [NO_VELOCITY] * 4, 0
        if is_locked:
            distance = max(1, round(100.0 * sample.altitude * scale))
            speeds = [millimetres(scale * speed) for speed in self._speeds(sample, attitude)]
            strength = max(40, min(220, round(160.0 - 20.0 * log10(sample.altitude) / 0.61)))
        high, low = divmod(distance, 65_536)
        data = pack("<HH2xBB2xH4x4H4h", 0x600, 1, 220, 24, 1000, *[low] * 4, *speeds)
        data += bytes([250 * is_locked] * 4 + [strength] * 4 + [100 * is_locked] * 4)
        data += pack("<6x4h12xH", *[NO_VELOCITY] * 4, reach)  # of a layer of water, which is not tracked
        return data + bytes([strength] * 4 + [1] + [high] * 4)

    def _speeds(self, sample: DvlSample, attitude: Quaternion) -> Sequence[float]:
        """Return the four speeds (m/s) in the chosen coordinates, of the bottom past the DVL."""
        forward, starboard, down = sample.velocity
        coordinates = int(self._values["EX"][:2], 2)
        if coordinates == _BEAM:
            tilt = radians(_BEAM_ANGLE)
            return [sin(tilt) * side + cos(tilt) * down for side in (-starboard, starboard, forward, -forward)]
        if coordinates == _EARTH:
            north, east, below = rotate(attitude, sample.velocity)
            return -east, -north, below, 0.0
        return -starboard, -forward, down, 0.0


def ensemble(sections: Sequence[bytes]) -> bytes:
    """Return an ensemble of PD0: header with offsets, data types, two reserved bytes, and the sum of all."""
    *offsets, end = accumulate(map(len, sections), initial=6 + 2 * len(sections))
    header = pack(f"<BBHxB{len(sections)}H", 0x7F, 0x7F, end + 2, len(sections), *offsets)
    body = header + b"".join(sections) + b"\0\0"
    return body + pack("<H", sum(body) & 0xFFFF)
