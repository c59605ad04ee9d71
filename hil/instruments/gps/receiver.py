"""A u-blox receiver of the ninth generation: sentences and UBX messages by its configuration, a fix at the surface."""

from random import Random

from hil.client.client import Stamped
from hil.common.clock import NS_PER_MS, NS_PER_S, to_wall_ns
from hil.common.vectors import Vector3
from hil.instruments.contract import Client, Instrument, Reader
from hil.instruments.gps import configuration as keys
from hil.instruments.gps import nmea, ubx
from hil.instruments.gps.sky import SPEED_ACCURACY, Epoch, make_epoch
from hil.instruments.layout import sentence
from sim.rotations import rotate
from sim.sensors.extra_samples import FixSample
from sim.sensors.samples import Sensor

_RESET, _COLD_START_S, _HOT_START_S = 0x04, 24.0, 2.0  # CFG-RST; NEO-M9N (data sheet)


class Receiver(Instrument):
    """One receiver, which talks NMEA at 1 Hz until a client configures it.

    Position and loss of the fix under water are those of the sensor. If its configured rate is another than the
    sensor's, it measures at that rate with errors of its own. The velocity is the true one of the antenna with the
    receiver's noise. Its clock goes on by battery, so it knows the time without a fix.
    """

    sensors = ("gps",)
    baud = 38_400
    warm_up_s = 0.5

    def prepare(self) -> None:
        """Set its state at power on."""
        stored = self.facts.memory.setdefault("values", {keys.BAUD: self.facts.baud})
        self._configuration = keys.Configuration(stored)
        self._random = Random(self.facts.seed)
        self._own: Sensor | None = None  # measures at the configured rate, if that is not the sensor's
        self._own_ms = 0
        self._search_until_ns = 0
        self._epochs = 0
        self._last: Epoch | None = None

    def start(self, now_ns: int) -> None:
        """Name itself, as the device does after power on."""
        self._apply(now_ns)
        if self._configuration.values[keys.OUT_NMEA]:
            self.send(sentence(nmea.GREETING))

    def new_reader(self, client: Client) -> Reader:
        """Return a reader of UBX messages; sentences and corrections are read over."""
        return ubx.Reader()

    def on_message(self, client: Client, message: tuple[int, int, bytes], now_ns: int) -> None:
        """Carry out a message."""
        group, number, payload = message
        if (group, number) == (ubx.CFG, _RESET):  # is not acknowledged
            is_cold = payload[:2] == b"\xff\xff"
            self._search_until_ns = now_ns + round((_COLD_START_S if is_cold else _HOT_START_S) * NS_PER_S)
        elif group == ubx.CFG:
            answer = self._configuration.carry_out(number, payload)
            if isinstance(answer, bytes):
                self.send(ubx.frame(ubx.CFG, number, answer), client)
            is_accepted = isinstance(answer, bytes) or answer
            self.send(ubx.frame(ubx.ACK, int(is_accepted), bytes((group, number))), client)
            self._apply(now_ns)
        elif (group, number) == (ubx.MON, ubx.VERSION) and not payload:
            self.send(ubx.version(), client)
        elif (group, number) == (ubx.PUBX, 41):  # is not answered
            self.malformed += not self._configuration.proprietary(payload)
            self._apply(now_ns)
        elif (group, number) in ubx.MESSAGES and not payload and self._last:
            self.send(ubx.encode(group, number, self._last), client)

    def _apply(self, now_ns: int) -> None:
        values = self._configuration.values
        self.set_baud(values[keys.BAUD])
        period_ms = values[keys.MEASUREMENT_MS] * values[keys.NAVIGATION_RATE]
        if period_ms == self._own_ms:
            return
        self._own_ms = period_ms
        rate = 1000.0 / period_ms
        is_the_sensors = abs(rate - self.facts.model.rate) < 1e-3 * rate
        self._own = None if is_the_sensors else self.scene.build(self.facts.model._replace(rate=rate))
        self.timers[self._measure] = now_ns + period_ms * NS_PER_MS

    def on_sample(self, topic: str, stamped: Stamped, now_ns: int) -> None:
        """Send the messages of an epoch."""
        if self._own is None:
            self._send_epoch(stamped.value, stamped.sent_ns, now_ns)

    def _measure(self, due_ns: int, now_ns: int) -> None:
        """Measure at the configured rate."""
        if self._own:
            self.timers[self._measure] = max(due_ns + self._own_ms * NS_PER_MS, now_ns)
            sample = self.scene.measure(self._own, now_ns)
            if isinstance(sample, FixSample):
                self._send_epoch(sample._replace(time_ns=to_wall_ns(now_ns)), now_ns, now_ns)

    def _send_epoch(self, fix: FixSample, measured_ns: int, now_ns: int) -> None:
        if measured_ns < self._search_until_ns:
            fix = fix._replace(fix=False)
        epoch = self._last = make_epoch(fix, self.facts.origin_altitude, self._velocity(now_ns))
        values, data = self._configuration.values, b""
        if values[keys.OUT_NMEA]:
            due = [number for number in nmea.SENTENCES if self._is_due(keys.NMEA, number)]
            data += b"".join(nmea.encode(number, epoch) for number in due)
        if values[keys.OUT_UBX]:
            data += b"".join(ubx.encode(*name, epoch) for name in ubx.MESSAGES if self._is_due(*name))
        self._epochs += 1
        if data:
            self.send(data, measured_ns=measured_ns)

    def _is_due(self, group: int, number: int) -> bool:
        rate = self._configuration.values[keys.RATES[group, number] + keys.UART1]
        return bool(rate) and self._epochs % rate == 0

    def _velocity(self, now_ns: int) -> Vector3:
        """Return the measured velocity of the antenna, north, east and down (m/s)."""
        state = self.scene.state(now_ns)
        if state is None:
            return 0.0, 0.0, 0.0
        true = rotate(state.quaternion, self.facts.mounting.velocity(state.nu))
        north, east, down = [value + self._random.gauss(0.0, SPEED_ACCURACY) for value in true]
        return north, east, down
