"""Water Linked Sonar 3D-15: range and strength images, inertial samples, and all settings of its interface of HTTP.

Packets are those of the Range Image Protocol, version 2: "RIP2", length, compressed protobuf message, CRC-32; source:
the .proto file of github.com/waterlinked/wlsonar. Few fields are written, so they are packed here, without protobuf's
library. The message stands in one literal of the Snappy format, which every reader of that takes, uncompressed; an
image has at most 49 kB and fits in a datagram.

It needs a wire of HTTP and one of UDP, from which it sends to where its settings say: a multicast group, one address,
or nowhere.
"""

import json
import struct
from collections.abc import Iterable, Mapping
from datetime import datetime, timezone
from functools import partial
from ipaddress import ip_address
from math import pi
from typing import Annotated, Any, NamedTuple
from zlib import crc32

from hil.client.client import Stamped
from hil.common.clock import NS_PER_S, to_wall_ns
from hil.common.schema import Range
from hil.instruments.contract import Instrument, Response, datagrams_to
from hil.instruments.layout import fits, read_device
from sim.rotations import rotate_inverse
from sim.sensors.imaging.range_image import RangeImageModel, RangeImager, RangeImageSample
from sim.sensors.samples import ImuSample

_API = "/api/v1/integration/"
_GROUP = "224.0.0.96", 4747
_SCALE = 50.0 / 65536  # m a unit of a pixel, as in the published recording
_MODES = {  # images per s, field of view across (deg), frequency (Hz)
    "low-frequency": (5, 90.0, 1_200_000),
    "high-frequency": (20, 40.0, 2_400_000),
}
_HEIGHT_DEG = 40.0
_BATCH = 5  # inertial samples in a message; at 100 Hz the first is 50 ms old
_TEMPERATURE_LIMIT = 60.0  # °C; our choice
_LATEST = 2.0**36  # s since 1970, that its clock can be set to; our choice
_PACKAGE = b"type.googleapis.com/waterlinked.sonar.protocol."
_LITERAL = 61 << 2  # a literal whose length stands in the next two bytes
View = tuple[int, int, float, float]  # width and height of an image (pixels), and its field of view (deg)


class Sonar3DSettings(NamedTuple):
    """Version and temperature (°C) that it reports, and whether it has found a server of time."""

    version: str = "1.8.0"
    temperature: Annotated[float, Range(-40.0, 125.0, "°C")] = 32.5
    synchronised: bool = True


class Sonar3D(Instrument):
    """A Sonar 3D-15 at the place of a simulated forward-looking sonar, or of a laser, which costs less beside it.

    It measures itself, 5 or 20 images a second, once a client has told it where to send. The wire of UDP is that from
    which it sends; multicast needs the address of a network there, not 0.0.0.0, if there is no default route.
    """

    Model = Sonar3DSettings
    sensors = ("forward_sonar", "laser")
    at = ("http:127.0.0.1:8081", "udp:127.0.0.1:4746")
    wires = ("http", "udp")
    is_interactive = True
    also = ("imu",)

    def prepare(self) -> None:
        """Set its state at power on."""
        self._rules: dict[str, dict[str, Any]] = read_device("sonar_3d")
        first = {name: rule["first"] for name, rule in self._rules.items()}
        self._kept: dict[str, Any] = self.facts.memory.setdefault("settings", first)
        self._sequence = self._batches = 0
        self._inertial: list[ImuSample] = []
        self._offset_ns = 0  # of its clock, which a client may set
        self._rotation = self.facts.mounting.quaternion

    def start(self, now_ns: int) -> None:
        """Begin to measure."""
        self.timers[self._measure] = now_ns

    def on_sample(self, topic: str, stamped: Stamped, now_ns: int) -> None:
        """Collect inertial samples, if they are asked for."""
        if topic != "imu" or not (self._kept["output/imu-batch/enabled"] and self._kept["acoustics/enabled"]):
            return
        self._inertial.append(stamped.value)
        if len(self._inertial) >= _BATCH:
            forces = [x for sample in self._inertial for x in rotate_inverse(self._rotation, sample.acceleration)]
            rates = [x for sample in self._inertial for x in rotate_inverse(self._rotation, sample.angular_velocity)]
            times = [sample.time_ns + self._offset_ns for sample in self._inertial]
            self._emit((imu_batch(self._batches, times, forces, rates),), stamped.sent_ns)
            self._batches += 1
            self._inertial.clear()

    def _measure(self, due_ns: int, now_ns: int) -> None:
        """Measure an image, which is sent when its last echo has come."""
        kept = self._kept
        rate, across, frequency = _MODES[kept["acoustics/mode"]]
        self.timers[self._measure] = max(due_ns + NS_PER_S // rate, now_ns)
        reach, speed = kept["acoustics/range"], kept["acoustics/speed_of_sound"]
        state = self.scene.state(now_ns)
        if state is None or not kept["acoustics/enabled"] or kept["udp"]["mode"] == "disabled":
            return
        # The device converts times with the speed that it was given.
        scale = speed / self.facts.sound_speed(self.facts.mounting.depth(state))
        model = RangeImageModel(
            field_across=across * pi / 180.0, field_down=_HEIGHT_DEG * pi / 180.0, frequency=frequency,
            min_range=reach["min"] / scale, max_range=reach["max"] / scale,
        )  # fmt: skip
        sample = self.scene.measure(self.tuned(model, sensor=RangeImager), now_ns)
        if not isinstance(sample, RangeImageSample):
            return
        import numpy as np

        height, width = sample.ranges.shape
        head = image_head(to_wall_ns(now_ns) + self._offset_ns, self._sequence, speed, reach["max"], frequency)
        view = width, height, across, _HEIGHT_DEG
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        ranges = np.clip(np.rint(sample.ranges * (scale / _SCALE)), 0, 0xFFFF)
        levels = 100.0 * np.log10(np.maximum(sample.strengths, 30.0) / 30.0)
        strengths = strength_image(head, view, np.clip(levels, 0, 255).astype(np.uint8).tobytes())
        packets = range_image(head, view, _SCALE, ranges), strengths
        self.timers[partial(self._emit, packets)] = now_ns + round(2e9 * reach["max"] / speed)

    def _emit(self, packets: Iterable[bytes], measured_ns: int, _: int = 0) -> None:
        """Send packets to where the settings say."""
        udp = self._kept["udp"]
        if udp["mode"] != "disabled":
            given = udp["unicast_destination_ip"], udp["unicast_destination_port"]
            to = _GROUP if udp["mode"] == "multicast" else given
            for packet in packets:
                self.send(packet, datagrams_to(*to), measured_ns=measured_ns)

    def on_request(self, method: str, path: str, query: Mapping[str, str], body: bytes, now_ns: int) -> Response:
        """Answer a request of HTTP."""
        name, told = path.removeprefix(_API), self._kept | self._status(now_ns)
        if method == "GET" and name in told:
            return _answer(told[name])
        if method != "POST" or not path.startswith(_API):
            return _NOT_FOUND
        try:
            value = json.loads(body)
        except (ValueError, RecursionError):
            return _BAD_REQUEST
        if name == "time/manual":
            return self._set_time(value, now_ns)
        if name == "time/ntp/force-sync":
            found = self.settings.synchronised
            message = "synchronized" if found else "no server of time answered"
            return _answer({"success": found, "message": message, "status": told["time/status"]})
        if name not in self._kept:
            return _NOT_FOUND
        if not (fits(value, self._rules[name]["fits"]) and _agrees(value)):
            return _BAD_REQUEST
        self._kept[name] = value
        return Response(b"", 204)

    def _status(self, now_ns: int) -> dict[str, Any]:
        """Return what it tells of itself, by the names of the requests."""
        version, temperature, is_synced = self.settings
        is_cool = temperature < _TEMPERATURE_LIMIT
        about = {
            "chipid": f"0x{self.facts.seed:08x}", "hardware_revision": 6, "is_ready": True, "product_id": 21045,
            "product_name": "Sonar 3D-15", "variant": "", "version": f"{version} (simulated)", "version_short": version,
        }  # fmt: skip
        status = {
            "api": _entry("api", True, "Integration API is operational."),
            "temperature": _entry("temperature", is_cool, "Temperature is normal." if is_cool else "Too hot."),
            "systems_check": _entry("systems-check", True, "Processing is operational."),
            "time": _entry("time", is_synced, "Time synchronization."),
        }
        time = datetime.fromtimestamp((to_wall_ns(now_ns) + self._offset_ns) / NS_PER_S, timezone.utc)
        clock = {
            "system_time": time.isoformat(), "ntp_synced": is_synced,
            "ntp_synced_to": self._kept["time/ntp"]["ntp_address"] if is_synced else "",
            "ntp_seconds_since_last_sync": 0 if is_synced else None,
        }  # fmt: skip
        return {"about": about, "temperature": temperature, "status": status, "time/status": clock}

    def _set_time(self, value: Any, now_ns: int) -> Response:
        """Set its clock, unless a server of time does."""
        try:
            wanted = datetime.fromisoformat(str(value["now"]).replace("Z", "+00:00")).timestamp()
        except (ValueError, TypeError, KeyError, OverflowError, OSError):
            return _BAD_REQUEST
        if not 0.0 <= wanted < _LATEST:
            return _BAD_REQUEST
        if self.settings.synchronised:
            return Response(b'{"error":"already synchronized"}', 409)
        self._offset_ns = round(wanted * NS_PER_S) - to_wall_ns(now_ns)
        return Response(b"", 204)


def _agrees(value: Any) -> bool:
    """Return whether the fields of a setting, if it has several, agree with each other."""
    if not isinstance(value, dict):
        return True
    if "min" in value:
        return bool(value["min"] < value["max"])
    if "ntp_address" in value:
        return bool(value["ntp_address"])
    address, port = value["unicast_destination_ip"], value["unicast_destination_port"]
    try:
        ip_address(address or _GROUP[0])
    except ValueError:
        return False
    return isinstance(port, int) and (value["mode"] != "unicast" or bool(address and port))


def _answer(value: Any) -> Response:
    return Response(json.dumps(value).encode())


_BAD_REQUEST = Response(b'{"error":"bad request"}', 400)
_NOT_FOUND = Response(b"404 page not found", 404, "text/plain")


def _entry(name: str, is_good: bool, message: str) -> dict[str, Any]:
    status, end = ("ok", "normal") if is_good else ("warning", "abnormal")
    return {"id": f"{name}-{end}", "message": message, "operational": is_good, "status": status}


def image_head(time_ns: int, sequence: int, speed_of_sound: float, reach: float, frequency: int) -> bytes:
    """Return the first fields of a message with an image: time (ns since 1970), number, and settings."""
    header = _message((1, _timestamp(time_ns)), (2, sequence))
    return _message((1, header), (2, float(speed_of_sound)), (3, float(reach)), (4, frequency))


def range_image(head: bytes, view: View, scale: float, pixels: Any) -> bytes:
    """Return the packet of a range image; each of `pixels`, a numpy array, times `scale` is a distance in m."""
    import numpy as np

    value = np.asarray(pixels, np.uint16).ravel()
    more, most = value > 0x7F, value > 0x3FFF
    digits = np.stack([value & 0x7F | more << 7, value >> 7 & 0x7F | most << 7, value >> 14], axis=1).astype(np.uint8)
    packed = digits[np.stack([np.ones_like(more), more, most], axis=1)].tobytes()
    return _packet(b"RangeImage", head + _message(*enumerate(view, 5), (9, scale), (10, packed)))


def strength_image(head: bytes, view: View, pixels: bytes) -> bytes:
    """Return the packet of the strengths of the echoes, a byte each: 100 log10(strength / 30)."""
    return _packet(b"BitmapImageGreyscale8", head + _message(*enumerate(view, 6), (10, pixels)))


def imu_batch(sequence: int, times_ns: Iterable[int], forces: Iterable[float], rates: Iterable[float]) -> bytes:
    """Return the packet of inertial samples: times, and three specific forces (m/s²) and rates (rad/s) of each."""
    times = [(3, _timestamp(time_ns)) for time_ns in times_ns]
    vectors = [(field, b"".join(struct.pack("<f", x) for x in values)) for field, values in ((4, forces), (5, rates))]
    return _packet(b"ImuBatch", _message((1, sequence), (2, len(times)), *times, *vectors))


def _packet(name: bytes, message: bytes) -> bytes:
    body = _message((1, _message((1, _PACKAGE + name), (2, message))))
    body = _varint(len(body)) + bytes((_LITERAL,)) + struct.pack("<H", len(body) - 1) + body
    head = b"RIP2" + struct.pack("<I", len(body) + 12)
    return head + body + struct.pack("<I", crc32(head + body))


def _timestamp(time_ns: int) -> bytes:
    seconds, rest = divmod(time_ns, NS_PER_S)
    return _message((1, seconds), (2, rest))


def _message(*fields: tuple[int, int | float | bytes]) -> bytes:
    """Return the fields of a message of protobuf, each by its number, in the form of its value's type."""
    data = b""
    for number, value in fields:
        if isinstance(value, float):
            data += _varint(number << 3 | 5) + struct.pack("<f", value)
        elif isinstance(value, bytes):
            data += _varint(number << 3 | 2) + _varint(len(value)) + value
        else:
            data += _varint(number << 3) + _varint(value)
    return data


def _varint(value: int) -> bytes:
    data = bytearray()
    while value > 0x7F:
        data.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes((*data, value))
