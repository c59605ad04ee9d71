"""Water Linked DVL A50 and A125: JSON and PD formats over TCP, lines with a CRC-8 or PD formats over serial.

The rate falls with the altitude, up to the rate of the simulated sensor. Source: Water Linked's documentation
(github.com/waterlinked/docs, docs/dvl), up to software 2.7.1. Not modelled: its web page; heat (bit 0 of the status).
"""

import json
from typing import Any

from hil.client.client import Stamped
from hil.common.clock import NS_PER_MS, NS_PER_S, NS_PER_US, to_wall_ns
from hil.common.errors import ConfigError
from hil.instruments.contract import Client, Instrument, Lines
from hil.instruments.dvl.formats import FORMATS, crc8, json_line, line, word
from hil.instruments.dvl.report import OPTIONS, DeadReckoning, DvlSettings, Report, with_fix
from sim.rotations import multiply

POSITION_NS = NS_PER_S // 5
CYCLE_NS = 10 * NS_PER_S  # between two validations of the bottom, each of which costs a measurement
IMU_STALE_NS = NS_PER_S
MOST_TRIGGERS = 15
CALIBRATION_NS = 5 * NS_PER_S  # ours: "up to 15 s"
SOFTWARE, LINE_VERSION = "2.7.1", "2,7,0"
CHIP = "0xf1440c09140b04"
PAUSE_NS = 100 * NS_PER_MS  # ours: the device waits 10 ms for the next byte, an adapter on USB delivers later
LONGEST_LINE = 257
PROTOCOLS = {0: "", 1: "all lines", 2: "pd6", 3: "lines", 6: "pd4"}  # by the numbers of `wcp`
FLAGS = {"y": True, "n": False}


class Dvl(Instrument):
    """A Doppler velocity log, from its power on."""

    Model = DvlSettings
    sensors = ("dvl",)
    at = ("tcp:127.0.0.1:16171",)
    also = ("odom", "imu", "dvl_water")
    first = b"{ \t\r\n"  # of JSON: a web page that posts to the port is refused
    delay_s = 0.004  # typical latency of a message over TCP
    product, most_m = "", 0.0

    def prepare(self) -> None:
        """Set its state at power on."""
        self._kept: dict[str, DvlSettings] = self.facts.memory  # what outlives the power
        self._kept.setdefault("config", self.settings)
        self._reckoning = DeadReckoning()
        self._mode: int | None = None  # its range mode; None while it searches the bottom
        self._triggers = 0  # pings that wait
        self._due_ns = self._last_ns = self._cycle_ns = self._imu_ns = 0
        self._attitude = self._orientation = (1.0, 0.0, 0.0, 0.0)  # of the vehicle and of the sensor's axes, NED
        self._depth = 0.0

    @property
    def _config(self) -> DvlSettings:
        return self._kept["config"]

    def start(self, now_ns: int) -> None:
        """Begin to ping."""
        self.timers[self._send_position], self._cycle_ns = now_ns, now_ns + CYCLE_NS

    def new_reader(self, client: Client) -> Lines:
        """Return the reader of a client."""
        return Lines(65_536 if client.kind == "tcp" else LONGEST_LINE)

    def _format(self, client: Client) -> str:
        formats = self.settings.formats
        if client.kind == "tcp":
            return str(formats[client.wire]) if client.wire < len(formats) else "json"
        return PROTOCOLS.get(self._config.serial_protocol, "lines")

    def on_sample(self, topic: str, stamped: Stamped, now_ns: int) -> None:
        """Take attitude and depth, and a sample of the ping's velocity when a ping is due."""
        sample = stamped.value
        if topic == "imu":
            self._attitude, self._imu_ns = sample.orientation, now_ns
        elif topic == "odom":
            self._depth = sample.position[2]
            if now_ns - self._imu_ns > IMU_STALE_NS:
                self._attitude = sample.orientation
        elif (topic == "dvl_water") == self._config.is_water and self._is_due(stamped.sent_ns):
            self._ping(sample, stamped.sent_ns, now_ns)
        if topic in ("imu", "odom"):
            self._orientation = multiply(self._attitude, self.facts.mounting.quaternion)
            self._reckoning.turn(self._orientation, self._config.mounting_rotation_offset)

    def tick(self, now_ns: int) -> int:
        """Send what is due, and refuse incomplete lines."""
        due_ns = super().tick(now_ns)
        for client, lines in self.readers.items():
            if lines.rest and client.kind != "tcp":
                until_ns = lines.read_ns + PAUSE_NS
                if now_ns >= until_ns or len(lines.rest) >= LONGEST_LINE:
                    lines.rest = b""
                    self._reply(client, "wr?")
                else:
                    due_ns = min(due_ns, until_ns)
        return due_ns

    def _send_position(self, due_ns: int, now_ns: int) -> None:
        self.timers[self._send_position] = max(due_ns + POSITION_NS, now_ns)
        for client in self.readers:
            encode = FORMATS.get(self._format(client), (None, None))[1]
            if encode:
                self.send(encode(self._reckoning, now_ns), client)

    def _is_due(self, measured_ns: int) -> bool:
        """Return whether the device pings now: by its rate, or because a ping was triggered."""
        config = self._config
        if not config.acoustic_enabled:
            is_triggered, self._triggers = self._triggers > 0, max(0, self._triggers - 1)
            return is_triggered
        if measured_ns < self._due_ns - NS_PER_MS:
            return False
        period_ns = round(NS_PER_S / config.rate(self._mode))
        behind = measured_ns - self._due_ns > period_ns
        self._due_ns = (measured_ns if behind else self._due_ns) + period_ns
        if config.periodic_cycling_enabled and not config.is_water and measured_ns >= self._cycle_ns:
            self._cycle_ns = measured_ns + CYCLE_NS
            return False
        return True

    def _ping(self, sample: Any, measured_ns: int, now_ns: int) -> None:
        config, rate = self._config, self._config.rate(self._mode)
        altitude = sample.altitude if sample.locked and sample.altitude == sample.altitude else None
        has_lock = sample.locked
        if not config.is_water:
            self._mode = config.follow(self._mode, altitude, self.most_m)
            has_lock = self._mode is not None
            if config.rate(self._mode) != rate:
                self._due_ns = measured_ns + round(NS_PER_S / config.rate(self._mode))
        since_ns = measured_ns - self._last_ns if self._last_ns else 0
        self._last_ns = measured_ns
        validity_us = to_wall_ns(measured_ns) // NS_PER_US
        report = Report(since_ns / NS_PER_MS, validity_us=validity_us, is_water=config.is_water)
        if has_lock:
            scale = config.speed_of_sound / self.facts.sound_speed(self._depth)
            x, y, z = [scale * speed for speed in sample.velocity]
            noise, above = scale * self.facts.model.velocity.noise, scale * altitude if altitude else -1.0
            offset = config.mounting_rotation_offset
            report = with_fix(report, (x, y, z), above, self._orientation, noise, offset)
        self._reckoning.move(report, measured_ns)
        for client in self.readers:
            if chosen := self._format(client):
                data = FORMATS[chosen][0](report, config, now_ns)
                self.send(data, client, measured_ns=measured_ns)

    # --- commands

    def on_message(self, client: Client, message: bytes, now_ns: int) -> None:
        """Execute one line, and respond; a client of PD4 or PD6 over TCP has no commands."""
        if client.kind != "tcp":
            self._reply(client, *self._answer(client, message, now_ns))
        elif self._format(client) == "json" and message.strip():
            self._take_json(client, message, now_ns)

    def _take_json(self, client: Client, message: bytes, now_ns: int) -> None:
        try:
            content = json.loads(message)
            command, parameters = content["command"], content.get("parameters") or {}
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            command = parameters = None
        if not isinstance(command, str) or not isinstance(parameters, dict):
            self.malformed += 1
            return

        def respond(result: Any = None, error: str = "") -> None:
            fields = {"response_to": command, "success": not error, "error_message": error, "result": result}
            self.send(json_line("response", fields), client)

        if command == "calibrate_gyro":
            self.timers[lambda *_: respond()] = now_ns + CALIBRATION_NS
            return
        try:
            respond(self._execute(command, parameters))
        except ConfigError as error:
            respond(error=str(error))

    def _execute(self, command: str, parameters: dict[str, Any]) -> Any:
        """Return the result of a command. Raises ConfigError, which says why it fails."""
        if command == "get_config":
            return self._config.options()
        if command == "set_config":
            self._kept["config"] = self._config.changed(parameters)
        elif command == "reset_dead_reckoning":
            self._reckoning = DeadReckoning()
            self._reckoning.turn(self._orientation, self._config.mounting_rotation_offset)
        elif command != "trigger_ping":
            raise ConfigError(f"unknown command {command[:40]}")
        elif self._triggers >= MOST_TRIGGERS:
            raise ConfigError("trigger queue is full")
        else:
            self._triggers += 1
        return None

    def _reply(self, client: Client, *words: object) -> None:
        self.malformed += words in (("wr?",), ("wr!",))
        if words:
            self.send(line(*words), client)

    def _answer(self, client: Client, text: bytes, now_ns: int) -> tuple[object, ...]:
        """Execute one line of a serial port; return the words of the reply."""
        command, mark, checksum = text.partition(b"*")
        if mark and checksum.lower() != b"%02x" % crc8(command):
            return ("wr!",)
        match command.decode("ascii", "replace").split(","):
            case ["wcv"]:
                return "wrv", LINE_VERSION
            case ["wcw"]:
                return "wrw", self.product.lower().replace(" ", "-"), SOFTWARE, CHIP
            case ["wcc"]:
                return "wrc", *map(word, self._config.options().values())
            case ["wcs", *options] if 4 <= len(options) <= len(OPTIONS):
                return self._configure(options)
            case ["wcr"]:
                return self._accept("reset_dead_reckoning", {})
            case ["wcx"]:
                return self._accept("trigger_ping", {})
            case ["wcg"]:
                self.timers[lambda *_: self._reply(client, "wra")] = now_ns + CALIBRATION_NS
                return ()
            case ["wcp", number]:
                if number not in map(str, PROTOCOLS):
                    return ("wrn",)
                self._kept["config"] = self._config._replace(serial_protocol=int(number))
                return ("wra",)
        return ("wr?",)

    def _accept(self, command: str, parameters: dict[str, Any]) -> tuple[str]:
        """Execute a command; return the reply."""
        try:
            self._execute(command, parameters)
        except ConfigError:
            return ("wrn",)
        return ("wra",)

    def _configure(self, words: list[str]) -> tuple[str]:
        """Set the options that are not blank; return the reply."""
        try:
            values = {key: _value(key, given) for key, given in zip(OPTIONS, words, strict=False) if given}
        except (ValueError, KeyError):
            return ("wr?",)
        return self._accept("set_config", values)


def _value(key: str, given: str) -> float | bool | str:
    return given if key == "range_mode" else float(given) if key in OPTIONS[:2] else FLAGS[given]


class A50(Dvl):
    """DVL A50, to 50 m: JSON, PD4 and PD6 over TCP, its lines, PD4 and PD6 over serial, with all commands.

    It reports 2 to 15 times a second by its altitude and range mode, at most at the sensor's rate. The four distances
    are those to a level seabed. Not modelled: its web page, heat, and the commands for version and time of software
    2.7.2.
    """

    product, most_m = "DVL A50", 50.0


class A125(Dvl):
    """DVL A125, to 125 m. It differs from an [A50](#waterlinked_a50) by its reach and name only."""

    product, most_m = "DVL A125", 125.0
