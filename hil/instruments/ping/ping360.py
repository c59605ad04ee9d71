"""Blue Robotics Ping360, a scanning sonar: all messages of the ping protocol, over UDP and serial, and its discovery.

Sources: the definitions of ping360 in github.com/bluerobotics/ping-protocol; values at power on, limits of the pulse,
the motor's 400 gradians in 2.4 s, the sense of the angle (200 gradians is ahead) and the answer to "Discovery" from
ping-viewer (src/sensor/ping360*); 18 ms a ping besides motor and sound from measurements at
discuss.bluerobotics.com/t/8328. Levels of the gains are our choice.
"""

from collections.abc import Callable
from math import pi
from typing import Annotated, Any, NamedTuple

from hil.common.clock import NEVER_NS
from hil.common.schema import Range
from hil.instruments.contract import Client, Facts, Scene, Send
from hil.instruments.ping.protocol import Byte, PingDevice, message
from sim.sensors.imaging.samples import EchoSample
from sim.sensors.imaging.scanning_sonar import ScanningSonar

DEVICE_DATA, AUTO_DEVICE_DATA = 2300, 2301
_TURN = 400  # gradians
_TICK = 25e-9  # s, of the sample period
_SPEED = 1500.0  # m/s; the device knows times only, so it does not matter which one the simulated sensor is told
_NS_PER_GRADIAN = 6_000_000
_PROCESSING_NS = 18_000_000
_RESTART_NS, _BOOTLOADER_NS = 1_000_000_000, 5_000_000_000  # the second is in the definition of `reset`
_GAINS = (-6.0, 0.0, 6.0)  # dB
_BOOT = {
    "mode": 1, "gain_setting": 0, "angle": 0, "transmit_duration": 32, "sample_period": 80, "transmit_frequency": 740,
    "number_of_samples": 1024, "start_angle": 0, "stop_angle": _TURN - 1, "num_steps": 1, "delay": 0, "data_length": 0,
}  # fmt: skip
_SOUND = "transmit_duration:H sample_period:H transmit_frequency:H"
_SOUND_FIELDS = tuple(word.partition(":")[0] for word in _SOUND.split())
_SECTOR = "start_angle:H stop_angle:H num_steps:B delay:B"


class Ping360Settings(NamedTuple):
    """Firmware that it reports, the angle of its head (gradians) ahead, and the addresses in its answer to `Discovery`.

    For the ROS driver `ping360_sonar`, which takes 0 as ahead, mount it so: `ahead = 0`.
    """

    firmware: tuple[Byte, Byte, Byte] = (3, 3, 8)
    ahead: Annotated[int, Range(0, _TURN - 1)] = 200
    mac: str = "54-10-EC-00-00-01"
    address: str = "127.0.0.1"


class Ping360(PingDevice):
    """A Ping360 at the place of a simulated scanning sonar: each ping has the client's angle, gain, range and pulse.

    It pings when a client asks, or scans by itself; motor and sound take the time measured on a Ping360 over Ethernet.
    It answers `Discovery` at each of its wires of UDP; `udp:0.0.0.0:30303` beside the first is the device's own.
    """

    Model = Ping360Settings
    sensors = ("scanning_sonar",)
    at = ("udp:127.0.0.1:9092",)
    first_id = 2
    readable = {  # noqa: RUF012
        DEVICE_DATA: message(
            "device_data",
            f"mode:B gain_setting:B angle:H {_SOUND} number_of_samples:H data_length:H", has_data=True,
        ),
        AUTO_DEVICE_DATA: message(
            "auto_device_data",
            f"mode:B gain_setting:B angle:H {_SOUND} {_SECTOR} number_of_samples:H data_length:H", has_data=True,
        ),
    }  # fmt: skip
    commands = {  # noqa: RUF012
        2000: message("set_device_id", "id:B reserved:B"),
        2600: message("reset", "bootloader:B reserved:B"),
        2601: message(
            "transducer", f"mode:B gain_setting:B angle:H {_SOUND} number_of_samples:H transmit:B reserved:B"
        ),
        2602: message("auto_transmit", f"mode:B gain_setting:B {_SOUND} number_of_samples:H {_SECTOR}"),
        2903: message("motor_off"),
    }
    limits = {  # noqa: RUF012
        "id": (1, 254), "device_id": (1, 254), "mode": (0, 1), "gain_setting": (0, 2), "angle": (0, _TURN - 1),
        "transmit_duration": (1, 1000), "sample_period": (80, 40_000), "transmit_frequency": (500, 1000),
        "number_of_samples": (200, 1200), "transmit": (0, 1), "start_angle": (0, _TURN - 1),
        "stop_angle": (0, _TURN - 1), "num_steps": (1, 10), "delay": (0, 100), "bootloader": (0, 1),
    }  # fmt: skip
    answered = ("transducer", "auto_transmit", "reset")

    def __init__(self, settings: Any, facts: Facts, scene: Scene, send: Send) -> None:
        super().__init__(settings, facts, scene, send)
        self.values |= _BOOT | {"device_type": 2, "version_minor": 1}
        self._sensor: Any = None
        self._keys: tuple[Any, ...] = ()
        self._next: Callable[[], None] = lambda: None  # what the device does at `_next_ns`
        self._next_ns = NEVER_NS
        self._ready_ns = 0
        self._owner: Client | None = None  # the client whose command is executed
        self._scans, self._transmits, self._forward = False, False, True
        self._echoes = b""

    def start(self, now_ns: int) -> None:
        """Load the world, which takes longer than a client waits for a ping."""
        self._prepare()

    def on_data(self, client: Client, data: bytes, now_ns: int) -> None:
        """Answer requests and discovery, and execute commands; not while it restarts."""
        if now_ns < self._ready_ns:
            return
        if client.kind == "udp" and data.startswith(b"Discovery"):
            address = ".".join(part.rjust(3, "0") for part in self.settings.address.split("."))
            lines = "SONAR PING360", "Blue Robotics", f"MAC Address:- {self.settings.mac}", f"IP Address:- {address}"
            self.send("".join(f"{line}\r\n" for line in lines).encode("ascii", "replace"), client)
            return
        super().on_data(client, data, now_ns)

    def disconnected(self, client: Client, now_ns: int) -> None:
        """Forget a client; a scan that it has started ends."""
        super().disconnected(client, now_ns)
        if client == self._owner:
            self._stop()

    def tick(self, now_ns: int) -> int:
        """Do what is due."""
        while self._next_ns <= now_ns:
            self._next()
        return self._next_ns

    def execute(self, client: Client, name: str, fields: dict[str, Any], now_ns: int) -> str:
        """Execute a command; return why not, or ""."""
        self._stop()
        if name == "reset":
            self._ready_ns = now_ns + (_BOOTLOADER_NS if fields["bootloader"] else _RESTART_NS)
            self.values |= _BOOT
        elif name in ("transducer", "auto_transmit"):
            head = self.values["angle"]
            self.values |= fields
            # The firmware limits the pulse to protect the transmitter.
            longest = min(500, fields["sample_period"] * 64 * 25 // 1000)
            self.values |= {"angle": head, "transmit_duration": min(max(fields["transmit_duration"], 5), longest)}
            self._owner, self._scans, self._forward = client, name == "auto_transmit", True
            self._transmits = self._scans or bool(fields["transmit"])
            self._turn(fields["start_angle" if self._scans else "angle"], now_ns)
        return ""

    def _stop(self) -> None:
        self._next_ns, self._scans = NEVER_NS, False

    def _turn(self, angle: int, now_ns: int) -> None:
        """Turn the head the shorter way, then transmit."""
        away = abs(angle - self.values["angle"]) % _TURN
        self.values["angle"] = angle
        self._next = self._transmit
        self._next_ns = now_ns + min(away, _TURN - away) * _NS_PER_GRADIAN

    def _transmit(self) -> None:
        """Ping, and listen until the last sample."""
        values = self.values
        self._echoes = self._measure(self._next_ns) if self._transmits else b""
        listening = values["sample_period"] * _TICK * values["number_of_samples"] if self._transmits else 0.0
        self._next = self._report
        self._next_ns += round(listening * 1e9) + _PROCESSING_NS

    def _prepare(self) -> None:
        """Build the simulated sensor for the settings, if they are others than before."""
        values = self.values
        keys = tuple(values[name] for name in ("gain_setting", *_SOUND_FIELDS, "number_of_samples"))
        if keys != self._keys:
            model = self.facts.model
            reach = 0.5 * _SPEED * _TICK * values["sample_period"] * values["number_of_samples"]
            model = model._replace(
                bins=values["number_of_samples"], min_range=0.0, max_range=reach, sound_speed=_SPEED,
                frequency=1e3 * values["transmit_frequency"], pulse_length=1e-6 * values["transmit_duration"],
                gain=model.gain + _GAINS[values["gain_setting"]], ringing=min(model.ringing, 0.5 * reach),
                ground_truth=False,
            )  # fmt: skip
            self._sensor, self._keys = self.scene.build(model, sensor=ScanningSonar), keys

    def _measure(self, now_ns: int) -> bytes:
        """Return the echoes of a ping."""
        self._prepare()
        self._sensor.aim((self.values["angle"] - self.settings.ahead) * 2.0 * pi / _TURN)
        sample = self.scene.measure(self._sensor, now_ns)
        return sample.echoes.intensities if isinstance(sample, EchoSample) else bytes(self.values["number_of_samples"])

    def _report(self) -> None:
        """Send the ping, and go on if it scans."""
        at_ns, self._next_ns = self._next_ns, NEVER_NS
        self.values["data_length"] = len(self._echoes)
        number = AUTO_DEVICE_DATA if self._scans else DEVICE_DATA
        self.send_message(number, self._owner, self._echoes, measured_ns=at_ns)
        self.values["data_length"] = 0
        if self._scans:
            self._turn(self._next_angle(), at_ns + self.values["delay"] * 1_000_000)

    def _next_angle(self) -> int:
        """Return the next angle of a scan: round and round, or forth and back in a sector."""
        values = self.values
        sector = (values["stop_angle"] - values["start_angle"]) % _TURN
        at, step = (values["angle"] - values["start_angle"]) % _TURN, values["num_steps"]
        if sector == _TURN - 1:
            return int((values["angle"] + step) % _TURN)
        if not 0 <= at + (step if self._forward else -step) <= sector:
            self._forward = not self._forward
        at = min(max(at + (step if self._forward else -step), 0), sector)
        return int((values["start_angle"] + at) % _TURN)
