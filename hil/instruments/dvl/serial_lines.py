"""The DVL's lines on a serial port: `w`, direction, command, options and a CRC-8."""

from hil.common.clock import NEVER_NS, NS_PER_MS, NS_PER_S, NS_PER_US, to_wall_ns
from hil.common.errors import ConfigError
from hil.instruments.dvl.device import DvlWire
from hil.instruments.dvl.pd import encode_pd4, encode_pd6
from hil.instruments.dvl.report import Report
from hil.links.frame.checksums import CRCS, crc_checksum

VERSIONS = {"2.6.1": "2,6,0", "2.7.1": "2,7,0"}  # by the software
CHIP = "0xf1440c09140b04"
PAUSE_NS = 100 * NS_PER_MS  # ours: the device waits 10 ms for the next byte, an adapter on USB delivers later
NOTHING, WITH_OLD, PD6, WITHOUT_OLD, PD4 = 0, 1, 2, 3, 6  # numbers of `wcp`
# The options of `wcs` and `wrc`, in their order.
OPTIONS = (
    "speed_of_sound", "mounting_rotation_offset", "acoustic_enabled", "dark_mode_enabled", "range_mode",
    "periodic_cycling_enabled",
)  # fmt: skip
FLAGS = {"y": True, "n": False}
crc8 = crc_checksum(CRCS["crc8"]).of


def line(*words: object) -> bytes:
    """Return a line of these words with its checksum."""
    text = ",".join(map(str, words)).encode()
    return b"%b*%02x\r\n" % (text, crc8(text))


class SerialWire(DvlWire):
    """A serial port."""

    longest = 257
    _read_ns = 0

    def feed(self, data: bytes, now_ns: int) -> None:
        """Take bytes of the client."""
        self._read_ns = now_ns
        for text in self._lines.read(data):
            self._answer(text, now_ns)
        if len(self._lines.rest) >= self.longest:
            self._refuse()

    def report(self, report: Report, now_ns: int) -> bytes:
        """Return a ping in the serial protocol that was chosen."""
        protocol, config = self._dvl.kept.serial_protocol, self._dvl.kept.config
        if protocol in (PD4, PD6):
            return encode_pd4(report, config) if protocol == PD4 else encode_pd6(report, config)
        return _encode(report, protocol == WITH_OLD, now_ns) if protocol else b""

    def position(self, now_ns: int) -> bytes:
        """Return a dead reckoning report."""
        reckoning = self._dvl.reckoning
        if self._dvl.kept.serial_protocol not in (WITH_OLD, WITHOUT_OLD):
            return b""
        numbers = [f"{value:.2f}" for value in (*reckoning.position, reckoning.std)]
        angles = [f"{value:.1f}" for value in reckoning.angles]
        return line("wrp", f"{to_wall_ns(now_ns) / NS_PER_S:.3f}", *numbers, *angles, 0)

    def tick(self, now_ns: int) -> int:
        """Refuse a line that does not go on."""
        if self._lines.rest and now_ns >= self._read_ns + PAUSE_NS:
            self._refuse()
        return self._read_ns + PAUSE_NS if self._lines.rest else NEVER_NS

    def _refuse(self) -> None:
        self._lines.rest = b""
        self._dvl.malformed += 1
        self._reply("wr?")

    def _reply(self, *words: object) -> None:
        self._dvl.send(line(*words), self._client)

    def _acknowledge(self, is_done: bool = True) -> None:
        self._reply("wra" if is_done else "wrn")

    def _answer(self, text: bytes, now_ns: int) -> None:
        """Execute one line, and reply as the device does."""
        command, mark, checksum = text.partition(b"*")
        if mark and checksum.lower() != b"%02x" % crc8(command):
            self._dvl.malformed += 1
            self._reply("wr!")
            return
        dvl = self._dvl
        match command.decode("ascii", "replace").split(","):
            case ["wcv"]:
                self._reply("wrv", VERSIONS[dvl.settings.software])
            case ["wcw"]:
                self._reply("wrw", dvl.product.lower().replace(" ", "-"), dvl.settings.software, CHIP)
            case ["wcc"]:
                self._reply("wrc", *[_word(getattr(dvl.kept.config, key)) for key in OPTIONS])
            case ["wcs", *options] if 4 <= len(options) <= len(OPTIONS):
                self._configure(options)
            case ["wcr"]:
                dvl.reset_reckoning()
                self._acknowledge()
            case ["wcx"]:
                self._acknowledge(dvl.trigger())
            case ["wcg"]:
                dvl.calibrate(now_ns, self._acknowledge)
            case ["wcp", "0" | "1" | "2" | "3" | "6" as number]:
                dvl.kept.serial_protocol = int(number)
                self._acknowledge()
            case ["wcp", _]:
                self._acknowledge(False)
            case _:
                self._refuse()

    def _configure(self, words: list[str]) -> None:
        """Set the options that are not blank."""
        kept = self._dvl.kept
        try:
            values = {key: _value(key, word) for key, word in zip(OPTIONS, words, strict=False) if word}
        except (ValueError, KeyError):
            self._refuse()
            return
        try:
            kept.config = kept.config.changed(values)
        except ConfigError:
            self._acknowledge(False)
        else:
            self._acknowledge()


def _value(key: str, word: str) -> float | bool | str:
    return word if key == "range_mode" else float(word) if key in OPTIONS[:2] else FLAGS[word]


def _word(value: float | bool | str) -> str:
    return value if isinstance(value, str) else "ny"[value] if isinstance(value, bool) else f"{value:.2f}"


def _encode(report: Report, with_old: bool, now_ns: int) -> bytes:
    """Return the lines of a ping, those of the deprecated format too if wanted."""
    velocity = [f"{speed:.3f}" for speed in report.velocity]
    valid, covariance = _word(report.is_valid), ";".join(f"{x:.6g}" for row in report.covariance for x in row)
    fom, milliseconds, altitude = f"{report.fom:.3f}", f"{report.milliseconds:.2f}", f"{report.altitude:.2f}"
    to_bottom = [] if report.is_water else [altitude]
    times = report.validity_us, to_wall_ns(now_ns) // NS_PER_US, milliseconds, 0
    data = line("wrs" if report.is_water else "wrz", *velocity, valid, *to_bottom, fom, covariance, *times)
    distances = [f"{one.distance:.2f}" for one in report.transducers]
    for number, one in enumerate(report.transducers):
        data += line("wru", number, f"{one.velocity:.3f}", distances[number], f"{one.rssi:.0f}", f"{one.nsd:.0f}")
    if with_old and not report.is_water:
        data += line("wrx", milliseconds, *velocity, fom, altitude, valid, 0)
        data += line("wrt", *distances)
    return data
