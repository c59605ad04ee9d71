"""Water Linked DVL A50 and A125: JSON and PD formats over TCP, lines with a CRC-8 or PD formats over serial.

The rate falls with the altitude, up to the rate of the simulated sensor. Source: Water Linked's documentation
(github.com/waterlinked/docs, docs/dvl), up to software 2.7.1. Not modelled: its web page; heat (bit 0 of the status).
"""

from typing import Any

from hil.client.client import Stamped
from hil.common.clock import NEVER_NS, NS_PER_MS, NS_PER_S, NS_PER_US, to_wall_ns
from hil.instruments.contract import Client, Facts, Scene, Send
from hil.instruments.dvl.device import DvlDevice, DvlSettings, DvlWire
from hil.instruments.dvl.json_lines import JsonWire
from hil.instruments.dvl.pd import Pd4Wire, Pd6Wire
from hil.instruments.dvl.report import RangeMode, Report, with_fix
from hil.instruments.dvl.serial_lines import SerialWire
from sim.rotations import multiply

POSITION_NS = NS_PER_S // 5
CYCLE_NS = 10 * NS_PER_S  # between two validations of the bottom, each of which costs a measurement
IMU_STALE_NS = NS_PER_S
FORMATS: dict[str, type[DvlWire]] = {"json": JsonWire, "pd6": Pd6Wire, "pd4": Pd4Wire, "serial": SerialWire}


class Dvl(DvlDevice):
    """A Doppler velocity log, from its power on."""

    sensors = ("dvl",)
    wires = ("tcp", "serial", "pty")
    at = ("tcp:127.0.0.1:16171",)
    also = ("odom", "imu", "dvl_water")
    first = b"{ \t\r\n"  # of JSON: a web page that posts to the port is refused
    delay_s = 0.004  # typical latency of a message over TCP
    most_m = 0.0

    def __init__(self, settings: DvlSettings, facts: Facts, scene: Scene, send: Send) -> None:
        super().__init__(settings, facts, scene, send)
        self._clients: dict[Client, DvlWire] = {}
        self._mode = RangeMode()
        self._due_ns = self._last_ns = self._cycle_ns = self._imu_ns = 0
        self._position_ns = NEVER_NS
        self._attitude = self.orientation
        self._depth = 0.0

    def start(self, now_ns: int) -> None:
        """Begin to ping."""
        self._position_ns, self._cycle_ns = now_ns, now_ns + CYCLE_NS

    def connected(self, client: Client, now_ns: int) -> None:
        """Take up a client in the format of its wire."""
        chosen = "json" if client.kind == "tcp" else "serial"
        if chosen == "json" and client.wire < len(self.settings.formats):
            chosen = self.settings.formats[client.wire]
        self._clients[client] = FORMATS[chosen](self, client)

    def disconnected(self, client: Client, now_ns: int) -> None:
        """Forget a client."""
        self._clients.pop(client, None)

    def on_data(self, client: Client, data: bytes, now_ns: int) -> None:
        """Take commands of a client."""
        if client in self._clients:
            self._clients[client].feed(data, now_ns)

    def on_sample(self, topic: str, stamped: Stamped, now_ns: int) -> None:
        """Take attitude and depth, and a sample of the ping's velocity when a ping is due."""
        sample = stamped.value
        if topic == "imu":
            self._attitude, self._imu_ns = sample.orientation, now_ns
        elif topic == "odom":
            self._depth = sample.position[2]
            if now_ns - self._imu_ns > IMU_STALE_NS:
                self._attitude = sample.orientation
        elif (topic == "dvl_water") == self.kept.config.is_water and self._is_due(stamped.sent_ns):
            self._ping(sample, stamped.sent_ns, now_ns)
        if topic in ("imu", "odom"):
            self.orientation = multiply(self._attitude, self.facts.mounting.quaternion)
            self.reckoning.turn(self.orientation, self.kept.config.mounting_rotation_offset)

    def tick(self, now_ns: int) -> int:
        """Send what is due: dead reckoning, answers of calibrations, refusals of incomplete lines."""
        if now_ns >= self._position_ns:
            self._position_ns = max(self._position_ns + POSITION_NS, now_ns)
            for client, wire in self._clients.items():
                if data := wire.position(now_ns):
                    self.send(data, client)
        while self.calibrations and self.calibrations[0][0] <= now_ns:
            self.calibrations.popleft()[1]()
        due_ns = min([wire.tick(now_ns) for wire in self._clients.values()], default=NEVER_NS)
        return min(due_ns, self._position_ns, self.calibrations[0][0] if self.calibrations else NEVER_NS)

    def _is_due(self, measured_ns: int) -> bool:
        """Return whether the device pings now: by its rate, or because a ping was triggered."""
        config = self.kept.config
        if not config.acoustic_enabled:
            is_triggered, self.triggers = self.triggers > 0, max(0, self.triggers - 1)
            return is_triggered
        if measured_ns < self._due_ns - NS_PER_MS:
            return False
        period_ns = round(NS_PER_S / self._mode.rate(config))
        behind = measured_ns - self._due_ns > period_ns
        self._due_ns = (measured_ns if behind else self._due_ns) + period_ns
        if config.periodic_cycling_enabled and not config.is_water and measured_ns >= self._cycle_ns:
            self._cycle_ns = measured_ns + CYCLE_NS
            return False
        return True

    def _ping(self, sample: Any, measured_ns: int, now_ns: int) -> None:
        config, rate = self.kept.config, self._mode.rate(self.kept.config)
        altitude = sample.altitude if sample.locked and sample.altitude == sample.altitude else None
        has_lock = sample.locked
        if not config.is_water:
            has_lock = self._mode.follow(altitude, config, self.most_m)
            if self._mode.rate(config) != rate:
                self._due_ns = measured_ns + round(NS_PER_S / self._mode.rate(config))
        since_ns = measured_ns - self._last_ns if self._last_ns else 0
        self._last_ns = measured_ns
        report = Report(
            since_ns / NS_PER_MS, validity_us=to_wall_ns(measured_ns) // NS_PER_US, is_water=config.is_water
        )
        if has_lock:
            noise, speed = self.facts.model.velocity.noise, self.facts.sound_speed(self._depth)
            report = with_fix(report, sample.velocity, altitude or -1.0, self.orientation, noise, config, speed)
        self.reckoning.move(report, measured_ns)
        for client, wire in self._clients.items():
            if data := wire.report(report, now_ns):
                self.send(data, client, measured_ns=measured_ns)


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
