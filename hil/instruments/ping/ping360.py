"""Blue Robotics Ping360, a scanning sonar: all messages of the ping protocol, over UDP and serial, and its discovery.

Sources: ping-viewer (src/sensor/ping360*) for the motor's 400 gradians in 2.4 s, the sense of the angle (200 gradians
is ahead) and the answer to "Discovery"; discuss.bluerobotics.com/t/8328 for 18 ms a ping besides motor and sound.
Levels of the gains are our choice.
"""

from collections.abc import Iterator
from math import pi
from typing import Annotated, Any, NamedTuple

from hil.common.clock import NEVER_NS
from hil.common.schema import Range
from hil.instruments.contract import Client
from hil.instruments.ping.protocol import Byte, PingDevice
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
_SOUND = "gain_setting", "transmit_duration", "sample_period", "transmit_frequency", "number_of_samples"


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
    table, first_id = "ping360", 2
    answered = ("transducer", "auto_transmit", "reset")

    def prepare(self) -> None:
        """Set its state at power on."""
        super().prepare()
        self.values |= {"device_type": 2, "version_minor": 1}
        self._steps: Iterator[int]  # of the command that is executed, for the client `_owner`
        self._owner: Client | None = None
        self._ready_ns = 0

    def start(self, now_ns: int) -> None:
        """Load the world, which takes longer than a client waits for a ping."""
        self._sonar()

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

    def _go_on(self, *_: int) -> None:
        """Go on with a command while the client is there that has given it."""
        if self._owner in self.readers:
            self.timers[self._go_on] = next(self._steps, NEVER_NS)

    def execute(self, client: Client, name: str, fields: dict[str, Any], now_ns: int) -> str:
        """Execute a command; return why not, or ""."""
        self.timers.clear()
        if name == "reset":
            self._ready_ns = now_ns + (_BOOTLOADER_NS if fields["bootloader"] else _RESTART_NS)
            self.values |= self.at_power_on
        elif name in ("transducer", "auto_transmit"):
            head = self.values["angle"]
            self.values |= fields
            # The firmware limits the pulse to protect the transmitter.
            longest = min(500, fields["sample_period"] * 64 * 25 // 1000)
            self.values |= {"angle": head, "transmit_duration": min(max(fields["transmit_duration"], 5), longest)}
            angle = fields["start_angle"] if name == "auto_transmit" else fields["angle"]
            self._owner, self._steps = client, self._run(client, angle, fields.get("transmit"), now_ns)
            self.timers[self._go_on] = next(self._steps)
        return ""

    def _run(self, client: Client, angle: int, transmit: int | None, at_ns: int) -> Iterator[int]:
        """Turn the head the shorter way, ping and report, again and again if it scans; yield each instant to wait for.

        `transmit` says whether it transmits a single ping; None to scan: round and round, or forth and back.
        """
        values, way = self.values, 1
        while True:
            away = abs(angle - values["angle"]) % _TURN
            values["angle"] = angle
            at_ns += min(away, _TURN - away) * _NS_PER_GRADIAN
            yield at_ns
            echoes, listening = b"", 0.0
            if transmit != 0:
                echoes = self._measure(at_ns)
                listening = values["sample_period"] * _TICK * values["number_of_samples"]
            at_ns += round(listening * 1e9) + _PROCESSING_NS
            yield at_ns
            self.data, values["data_length"] = echoes, len(echoes)
            self.send_message(AUTO_DEVICE_DATA if transmit is None else DEVICE_DATA, client, at_ns)
            self.data, values["data_length"] = b"", 0
            if transmit is not None:
                return
            at_ns += values["delay"] * 1_000_000
            start, step = values["start_angle"], values["num_steps"]
            sector, at = (values["stop_angle"] - start) % _TURN, (angle - start) % _TURN
            if sector == _TURN - 1:
                angle = (angle + step) % _TURN
            else:
                way = way if 0 <= at + way * step <= sector else -way
                angle = (start + min(max(at + way * step, 0), sector)) % _TURN

    def _sonar(self) -> Any:
        """Return the simulated sensor for the settings."""
        gain, duration, period, frequency, samples = [self.values[name] for name in _SOUND]
        model, reach = self.facts.model, 0.5 * _SPEED * _TICK * period * samples
        model = model._replace(
            bins=samples, min_range=0.0, max_range=reach, sound_speed=_SPEED, frequency=1e3 * frequency,
            pulse_length=1e-6 * duration, gain=model.gain + _GAINS[gain], ringing=min(model.ringing, 0.5 * reach),
            ground_truth=False,
        )  # fmt: skip
        return self.tuned(model, sensor=ScanningSonar)

    def _measure(self, now_ns: int) -> bytes:
        """Return the echoes of a ping."""
        sonar = self._sonar()
        sonar.aim((self.values["angle"] - self.settings.ahead) * 2.0 * pi / _TURN)
        sample = self.scene.measure(sonar, now_ns)
        return sample.echoes.intensities if isinstance(sample, EchoSample) else bytes(self.values["number_of_samples"])
