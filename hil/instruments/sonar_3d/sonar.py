"""Water Linked Sonar 3D-15: range and strength images, inertial samples, and all settings of its interface of HTTP.

Source: docs.waterlinked.com (sonar-3d-15-api with swagger.json). It needs a wire of HTTP and one of UDP, from which it
sends to where its settings say: a multicast group, one address, or nowhere.
"""

import json
from collections.abc import Mapping
from datetime import datetime, timezone
from ipaddress import ip_address
from math import pi
from typing import Annotated, Any, NamedTuple

from hil.client.client import Stamped
from hil.common.clock import NEVER_NS, NS_PER_S, to_wall_ns
from hil.common.schema import Range
from hil.instruments.contract import Facts, Instrument, Response, Scene, Send, datagrams_to
from hil.instruments.sonar_3d import packets
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
_REACH = 15.0
_BATCH = 5  # inertial samples in a message; at 100 Hz the first is 50 ms old
_TEMPERATURE_LIMIT = 60.0  # °C; our choice
_FIRST = {
    "acoustics/enabled": True, "acoustics/mode": "low-frequency", "acoustics/range": {"min": 0.0, "max": _REACH},
    "acoustics/salinity": "salt", "acoustics/speed_of_sound": 1500.0, "output/imu-batch/enabled": False,
    "udp": {"mode": "disabled", "unicast_destination_ip": "", "unicast_destination_port": 0},
    "time/ntp": {"ntp_address": "auto"},
}  # fmt: skip


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

    def __init__(self, settings: Any, facts: Facts, scene: Scene, send: Send) -> None:
        super().__init__(settings, facts, scene, send)
        self._kept: dict[str, Any] = facts.memory.setdefault("settings", dict(_FIRST))
        self._built: tuple[Any, ...] = ()
        self._imager: Any = None
        self._due_ns = self._ready_ns = NEVER_NS
        self._packets: tuple[bytes, ...] = ()
        self._sequence = self._batches = 0
        self._inertial: list[ImuSample] = []
        self._offset_ns = 0  # of its clock, which a client may set
        self._rotation = facts.mounting.quaternion

    def start(self, now_ns: int) -> None:
        """Begin to measure."""
        self._due_ns = now_ns

    def on_sample(self, topic: str, stamped: Stamped, now_ns: int) -> None:
        """Collect inertial samples, if they are asked for."""
        if topic != "imu" or not (self._kept["output/imu-batch/enabled"] and self._kept["acoustics/enabled"]):
            return
        self._inertial.append(stamped.value)
        if len(self._inertial) >= _BATCH:
            forces = [x for sample in self._inertial for x in rotate_inverse(self._rotation, sample.acceleration)]
            rates = [x for sample in self._inertial for x in rotate_inverse(self._rotation, sample.angular_velocity)]
            times = [sample.time_ns + self._offset_ns for sample in self._inertial]
            self._emit(packets.imu_batch(self._batches, times, forces, rates), stamped.sent_ns)
            self._batches += 1
            self._inertial.clear()

    def tick(self, now_ns: int) -> int:
        """Measure an image when it is due; send it when its last echo has come."""
        if self._ready_ns <= now_ns:
            for packet in self._packets:
                self._emit(packet, self._ready_ns)
            self._ready_ns = NEVER_NS
        if self._due_ns <= now_ns:
            self._due_ns = max(self._due_ns + NS_PER_S // _MODES[self._kept["acoustics/mode"]][0], now_ns)
            if self._kept["acoustics/enabled"] and self._kept["udp"]["mode"] != "disabled":
                self._image(now_ns)
        return min(self._due_ns, self._ready_ns)

    def _image(self, now_ns: int) -> None:
        kept = self._kept
        _, across, frequency = _MODES[kept["acoustics/mode"]]
        reach, speed = kept["acoustics/range"], kept["acoustics/speed_of_sound"]
        state = self.scene.state(now_ns)
        if state is None:
            return
        # The device converts times with the speed that it was given.
        scale = speed / self.facts.sound_speed(self.facts.mounting.depth(state))
        wanted = across, frequency, reach["min"] / scale, reach["max"] / scale
        if wanted != self._built:
            model = RangeImageModel(
                field_across=across * pi / 180.0, field_down=_HEIGHT_DEG * pi / 180.0, frequency=frequency,
                min_range=wanted[2], max_range=wanted[3],
            )  # fmt: skip
            self._imager, self._built = self.scene.build(model, sensor=RangeImager), wanted
        sample = self.scene.measure(self._imager, now_ns)
        if not isinstance(sample, RangeImageSample):
            return
        import numpy as np

        height, width = sample.ranges.shape
        shot = packets.Shot(
            to_wall_ns(now_ns) + self._offset_ns, self._sequence, speed, reach["max"], frequency, width, height, across,
            _HEIGHT_DEG,
        )  # fmt: skip
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        ranges = np.clip(np.rint(sample.ranges * (scale / _SCALE)), 0, 0xFFFF)
        levels = 100.0 * np.log10(np.maximum(sample.strengths, 30.0) / 30.0)
        strengths = packets.strength_image(shot, np.clip(levels, 0, 255).astype(np.uint8).tobytes())
        self._packets = packets.range_image(shot, _SCALE, ranges), strengths
        self._ready_ns = now_ns + round(2e9 * reach["max"] / speed)

    def _emit(self, packet: bytes, measured_ns: int) -> None:
        """Send a packet to where the settings say."""
        udp = self._kept["udp"]
        if udp["mode"] != "disabled":
            given = udp["unicast_destination_ip"], udp["unicast_destination_port"]
            to = _GROUP if udp["mode"] == "multicast" else given
            self.send(packet, datagrams_to(*to), measured_ns=measured_ns)

    def on_request(self, method: str, path: str, query: Mapping[str, str], body: bytes, now_ns: int) -> Response:
        """Answer a request of HTTP."""
        name = path.removeprefix(_API)
        if not path.startswith(_API):
            return Response(b"404 page not found", 404, "text/plain")
        if method == "GET":
            return self._read(name, now_ns)
        try:
            value = json.loads(body)
        except (ValueError, RecursionError):
            return Response(b'{"error":"bad request"}', 400)
        if method != "POST":
            return Response(b"404 page not found", 404, "text/plain")
        if name == "time/manual":
            return self._set_time(value, now_ns)
        if name == "time/ntp/force-sync":
            found = self.settings.synchronised
            message = "synchronized" if found else "no server of time answered"
            return _answer({"success": found, "message": message, "status": self._time_status(now_ns)})
        if name not in self._kept:
            return Response(b"404 page not found", 404, "text/plain")
        if not _is_allowed(name, value):
            return Response(b'{"error":"bad request"}', 400)
        self._kept[name] = value
        return Response(b"", 204)

    def _read(self, name: str, now_ns: int) -> Response:
        if name in self._kept:
            return _answer(self._kept[name])
        if name == "about":
            version = self.settings.version
            return _answer(
                {
                    "chipid": f"0x{self.facts.seed:08x}", "hardware_revision": 6, "is_ready": True, "product_id": 21045,
                    "product_name": "Sonar 3D-15", "variant": "", "version": f"{version} (simulated)",
                    "version_short": version,
                }
            )  # fmt: skip
        if name == "temperature":
            return _answer(self.settings.temperature)
        if name == "status":
            is_cool = self.settings.temperature < _TEMPERATURE_LIMIT
            return _answer(
                {
                    "api": _entry("api", True, "Integration API is operational."),
                    "temperature": _entry("temperature", is_cool, "Temperature is normal." if is_cool else "Too hot."),
                    "systems_check": _entry("systems-check", True, "Processing is operational."),
                    "time": _entry("time", self.settings.synchronised, "Time synchronization."),
                }
            )
        if name == "time/status":
            return _answer(self._time_status(now_ns))
        return Response(b"404 page not found", 404, "text/plain")

    def _time_status(self, now_ns: int) -> dict[str, Any]:
        is_synced = self.settings.synchronised
        time = datetime.fromtimestamp((to_wall_ns(now_ns) + self._offset_ns) / NS_PER_S, timezone.utc)
        return {
            "system_time": time.isoformat(), "ntp_synced": is_synced,
            "ntp_synced_to": self._kept["time/ntp"]["ntp_address"] if is_synced else "",
            "ntp_seconds_since_last_sync": 0 if is_synced else None,
        }  # fmt: skip

    def _set_time(self, value: Any, now_ns: int) -> Response:
        """Set its clock, unless a server of time does."""
        try:
            wanted = datetime.fromisoformat(str(value["now"]).replace("Z", "+00:00")).timestamp()
        except (ValueError, TypeError, KeyError, OverflowError, OSError):
            return Response(b'{"error":"bad request"}', 400)
        if self.settings.synchronised:
            return Response(b'{"error":"already synchronized"}', 409)
        self._offset_ns = round(wanted * NS_PER_S) - to_wall_ns(now_ns)
        return Response(b"", 204)


def _is_number(value: Any, low: float, high: float) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and low <= value <= high


def _is_allowed(name: str, value: Any) -> bool:
    """Return whether a setting may have a value; ranges are our choice."""
    if name == "acoustics/speed_of_sound":
        return _is_number(value, 1000.0, 2000.0)
    first: Any = _FIRST[name]
    if name in ("acoustics/mode", "acoustics/salinity"):
        return isinstance(value, str) and value in (_MODES if first in _MODES else ("salt", "fresh"))
    if isinstance(first, bool):
        return isinstance(value, bool)
    if not isinstance(value, dict) or value.keys() != first.keys():
        return False
    if name == "acoustics/range":
        near, far = value["min"], value["max"]
        return _is_number(near, 0.0, _REACH) and _is_number(far, 0.1, _REACH) and near < far
    if name == "time/ntp":
        return isinstance(value["ntp_address"], str) and bool(value["ntp_address"])
    address, port = value["unicast_destination_ip"], value["unicast_destination_port"]
    is_unicast = value["mode"] == "unicast"
    is_port = isinstance(port, int) and (1 if is_unicast else 0) <= port <= 65_535
    return value["mode"] in ("multicast", "unicast", "disabled") and is_port and _is_address(address, not is_unicast)


def _is_address(value: Any, may_be_empty: bool) -> bool:
    try:
        return isinstance(value, str) and (bool(value and ip_address(value)) or (may_be_empty and not value))
    except ValueError:
        return False


def _answer(value: Any) -> Response:
    return Response(json.dumps(value).encode())


def _entry(name: str, is_good: bool, message: str) -> dict[str, Any]:
    status, end = ("ok", "normal") if is_good else ("warning", "abnormal")
    return {"id": f"{name}-{end}", "message": message, "operational": is_good, "status": status}
