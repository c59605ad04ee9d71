"""The DVL's lines on a serial port: `w`, direction, command, options and a CRC-8."""

import re

from hil.common.clock import NEVER_NS, NS_PER_MS, NS_PER_S, NS_PER_US, to_wall_ns
from hil.instruments.contract import Client
from hil.instruments.waterlinked.dvl_device import DvlDevice
from hil.instruments.waterlinked.dvl_pd import encode_pd4, encode_pd6
from hil.instruments.waterlinked.dvl_report import Config, DeadReckoning, Report

VERSIONS = {"2.6.1": "2,6,0", "2.7.1": "2,7,0"}  # by the software
CHIP = "0xf1440c09140b04"
LONGEST = 256
PAUSE_NS = 100 * NS_PER_MS  # ours: the device waits 10 ms for the next byte, an adapter on USB delivers later
PROTOCOLS = {"0", "1", "2", "3", "6"}
FLAGS = {"y": True, "n": False}


def _table() -> list[int]:
    table = []
    for byte in range(256):
        for _ in range(8):
            byte = byte << 1 ^ (0x107 if byte & 0x80 else 0)
        table.append(byte & 0xFF)
    return table


_CRC = _table()


def crc8(data: bytes) -> int:
    """Return the CRC-8 with polynomial 7 and start value 0."""
    crc = 0
    for byte in data:
        crc = _CRC[crc ^ byte]
    return crc


def line(*words: object) -> bytes:
    """Return a line of these words with its checksum."""
    text = ",".join(map(str, words)).encode()
    return b"%b*%02x\r\n" % (text, crc8(text))


class SerialWire:
    """A serial port of the DVL `dvl`."""

    def __init__(self, dvl: DvlDevice, client: Client) -> None:
        self._dvl, self._client = dvl, client
        self._unread = b""
        self._read_ns = 0

    def feed(self, data: bytes, now_ns: int) -> None:
        """Take bytes of the client."""
        *lines, self._unread = re.split(b"[\r\n]", self._unread + data)
        self._read_ns = now_ns
        for text in lines:
            if text:
                self._answer(text, now_ns)
        if len(self._unread) > LONGEST:
            self._refuse()

    def report(self, report: Report, config: Config, now_ns: int) -> bytes:
        """Return a ping in the serial protocol that was chosen."""
        protocol = self._dvl.serial_protocol
        if protocol == 2:
            return encode_pd6(report, config)
        if protocol == 6:
            return encode_pd4(report, config)
        return _encode(report, protocol == 1, now_ns) if protocol else b""

    def position(self, reckoning: DeadReckoning, now_ns: int) -> bytes:
        """Return a dead reckoning report."""
        if self._dvl.serial_protocol not in (1, 3):
            return b""
        numbers = [f"{value:.2f}" for value in (*reckoning.position, reckoning.std)]
        angles = [f"{value:.1f}" for value in reckoning.angles]
        return line("wrp", f"{to_wall_ns(now_ns) / NS_PER_S:.3f}", *numbers, *angles, 0)

    def tick(self, now_ns: int) -> int:
        """Refuse a line that does not go on."""
        if not self._unread:
            return NEVER_NS
        if now_ns >= self._read_ns + PAUSE_NS:
            self._refuse()
            return NEVER_NS
        return self._read_ns + PAUSE_NS

    def _refuse(self) -> None:
        self._unread = b""
        self._dvl.malformed += 1
        self._reply("wr?")

    def _reply(self, *words: object) -> None:
        self._dvl.send(line(*words), self._client)

    def _answer(self, text: bytes, now_ns: int) -> None:
        """Execute one line, and reply as the device does."""
        command, mark, checksum = text.partition(b"*")
        if mark and checksum.lower() != b"%02x" % crc8(command):
            self._dvl.malformed += 1
            self._reply("wr!")
            return
        name, *options = command.decode("ascii", "replace").split(",")
        dvl = self._dvl
        if name == "wcv" and not options:
            self._reply("wrv", VERSIONS[dvl.software])
        elif name == "wcw" and not options:
            self._reply("wrw", dvl.product.lower().replace(" ", "-"), dvl.software, CHIP)
        elif name == "wcc" and not options:
            self._reply("wrc", *_configuration(dvl.config))
        elif name == "wcs" and 4 <= len(options) <= 6:
            self._configure(options)
        elif name == "wcr" and not options:
            dvl.reset_reckoning()
            self._reply("wra")
        elif name == "wcx" and not options:
            self._reply("wra" if dvl.trigger() else "wrn")
        elif name == "wcg" and not options:
            dvl.calibrate(now_ns, lambda: self._reply("wra"))
        elif name == "wcp" and len(options) == 1:
            self._choose(options[0])
        else:
            self._refuse()

    def _configure(self, options: list[str]) -> None:
        """Set the options that are not blank."""
        values: dict[str, float | bool | str] = {}
        keys = ("speed_of_sound", "mounting_rotation_offset", "acoustic_enabled", "dark_mode_enabled", "range_mode")
        try:
            for key, word in zip((*keys, "periodic_cycling_enabled"), options, strict=False):
                if word:
                    values[key] = word if key == "range_mode" else float(word) if key in keys[:2] else FLAGS[word]
        except (ValueError, KeyError):
            self._refuse()
            return
        try:
            self._dvl.config = self._dvl.config.changed(values)
        except ValueError:
            self._reply("wrn")
        else:
            self._reply("wra")

    def _choose(self, number: str) -> None:
        if number in PROTOCOLS:
            self._dvl.serial_protocol = int(number)
        self._reply("wra" if number in PROTOCOLS else "wrn")


def _configuration(config: Config) -> list[str]:
    marks = {True: "y", False: "n"}
    return [
        f"{config.speed_of_sound:.2f}", f"{config.mounting_rotation_offset:.2f}", marks[config.acoustic_enabled],
        marks[config.dark_mode_enabled], config.range_mode, marks[config.periodic_cycling_enabled],
    ]  # fmt: skip


def _encode(report: Report, with_old: bool, now_ns: int) -> bytes:
    """Return the lines of a ping, those of the deprecated format too if wanted."""
    velocity = [f"{speed:.3f}" for speed in report.velocity]
    valid, covariance = "y" if report.is_valid else "n", ";".join(f"{x:.6g}" for row in report.covariance for x in row)
    fom, milliseconds = f"{report.fom:.3f}", f"{report.milliseconds:.2f}"
    times = report.validity_us, to_wall_ns(now_ns) // NS_PER_US, milliseconds, 0
    if report.is_water:
        data = line("wrs", *velocity, valid, fom, covariance, *times)
    else:
        data = line("wrz", *velocity, valid, f"{report.altitude:.2f}", fom, covariance, *times)
    distances = [f"{one.distance:.2f}" for one in report.transducers]
    for number, one in enumerate(report.transducers):
        data += line("wru", number, f"{one.velocity:.3f}", distances[number], f"{one.rssi:.0f}", f"{one.nsd:.0f}")
    if with_old and not report.is_water:
        data += line("wrx", milliseconds, *velocity, fom, f"{report.altitude:.2f}", valid, 0)
        data += line("wrt", *distances)
    return data
