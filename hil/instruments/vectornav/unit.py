"""The VN-100, an attitude and heading reference, and the VN-200, which has a satellite receiver besides."""

from typing import Annotated, NamedTuple

from hil.client.client import Stamped
from hil.common.clock import NS_PER_MS, NS_PER_S, to_wall_ns
from hil.common.plugins import load_object
from hil.common.schema import Range
from hil.instruments.contract import Client, Instrument
from hil.instruments.gps.sky import make_epoch
from hil.instruments.layout import checksum, sentence
from hil.instruments.vectornav.outputs import DEVICE, MEASURED, NO_EPOCH, Measurement, parse_output, text_of
from sim.rotations import rotate
from sim.sensors.extra_samples import FixSample
from sim.sensors.kinds import SENSORS
from sim.sensors.magnetometer import Magnetometer, MagnetometerModel
from sim.sensors.samples import ImuSample, Sensor

_BAD_CHECKSUM, _BAD_COMMAND, _TOO_FEW, _TOO_MANY, _BAD_PARAMETER, _BAD_REGISTER, _READ_ONLY = 3, 4, 5, 6, 7, 8, 9
_INERTIAL_RATE = 800  # Hz, which the divisors of binary outputs divide
_RECEIVER_PERIOD_NS = 200 * NS_PER_MS
_RESTART_NS = 1250 * NS_PER_MS
_LARGEST_OUTPUT = 10  # parameters: ports, divisor, groups, and the fields of seven
# Disturbances that are known to the client, and the present rates as biases: for the filter, which is not simulated.
_ACCEPTED = ("VNKMD", "VNKAD", "VNSGB")
_IDENTITY = (1, 2, 3, 4)  # model, revision of the hardware, serial number, firmware
_BAUD, _KIND, _RATE, _PROTOCOL, _BINARY = 5, 6, 7, 30, (75, 76, 77)
_WITH_RECEIVER: list[int] = DEVICE["with_receiver"]
_OF_PORT: dict[int, list[str]] = {int(number): values for number, values in DEVICE["of_port"].items()}
_KINDS: dict[str, tuple[str, int]] = DEVICE["asynchronous"]  # of asynchronous output: header and register


class UnitSettings(NamedTuple):
    """Temperature (°C) and pressure (kPa) of the air around the unit, which it measures too; errors of its compass.

    Pressure is not that of the water: the unit is within the hull.
    """

    temperature: Annotated[float, Range(-40.0, 85.0, "°C")] = 25.0
    pressure: Annotated[float, Range(10.0, 120.0, "kPa")] = 101.325
    magnetometer: MagnetometerModel = MagnetometerModel()


class Vn100(Instrument):
    """A VN-100 from its factory settings on: YMR at 40 Hz until a client configures it.

    Attitude, rates and accelerations are those of the sensor, so an output is at most as fast as that: give it a rate
    of which the client's is a fraction. Yaw is from true north. Not modelled: the estimation of biases (compensated
    values equal uncompensated ones), calibrations by the client, synchronisation pulses.
    """

    Model = UnitSettings
    sensors = ("imu", "ahrs")
    warm_up_s = 1.25
    model_number = "VN-100T-CR"
    default_kind = "14"
    has_receiver = False

    def prepare(self) -> None:
        """Set its state at power on."""
        self._kept: dict[int, str] = self.facts.memory.setdefault("registers", {})
        self._magnetometer: Sensor | None = None
        self._last: Measurement | None = None
        self._epoch, self._place = NO_EPOCH, (0.0, 0.0, 0.0)  # of its receiver: the last one, and the last one found
        self._began_ns = self._silent_until_ns = 0
        self._restart()

    def _restart(self) -> None:
        identity = dict(zip(_IDENTITY, (self.model_number, "7", "0100011981", "2.1.0.0"), strict=True))
        factory = {int(number): text for number, text in DEVICE["factory"].items()}
        self._registers: dict[int, str] = (
            factory | identity | {_KIND: self.default_kind, _BAUD: str(self.facts.baud)} | self._kept
        )
        self._is_paused = False
        self._due_ns = dict.fromkeys(self._registers, 0)

    def start(self, now_ns: int) -> None:
        """Build the unit's magnetometer."""
        self._began_ns = now_ns
        self.set_baud(int(self._registers[_BAUD]))
        rate = max(1.0, self.facts.model.rate)
        self._magnetometer = self.scene.build(self.settings.magnetometer._replace(rate=rate), sensor=Magnetometer)

    def on_message(self, client: Client, message: bytes, now_ns: int) -> None:
        """Answer a line; what stands before its $ is noise."""
        _, mark, text = message.rpartition(b"$")
        if not mark or now_ns < self._silent_until_ns:
            self.malformed += 1
            return
        body, _, given = text.partition(b"*")
        given = given.strip().upper()
        answer: str | int = _BAD_CHECKSUM
        if given in (b"XX", checksum(body, with_crc=len(given) == 4)):
            command, *parameters = body.decode("latin-1").split(",")
            answer = self._execute(command, parameters, now_ns)
        if isinstance(answer, int):
            self.malformed += 1
            answer = f"VNERR,{answer:02d}"
        self.send(sentence(answer, self._has_crc), client)
        self.set_baud(int(self._registers[_BAUD]))

    @property
    def _has_crc(self) -> bool:
        return self._registers[_PROTOCOL].split(",")[4] == "3"

    def _execute(self, command: str, parameters: list[str], now_ns: int) -> str | int:
        """Carry out a command; return the answer, or the number of an error."""
        if command in ("VNRRG", "VNWRG"):
            return self._access(command, parameters)
        if command == "VNASY":
            if parameters not in (["0"], ["1"]):
                return _BAD_PARAMETER if parameters else _TOO_FEW
            self._is_paused = parameters == ["0"]
        elif command == "VNWNV":
            self._kept |= {number: text for number, text in self._registers.items() if number not in _IDENTITY}
        elif command in ("VNRFS", "VNRST"):
            if command == "VNRFS":
                self._kept.clear()
            self._restart()
            self._began_ns = self._silent_until_ns = now_ns + _RESTART_NS
        elif command == "VNBOM" and parameters in (["1"], ["2"], ["3"]):
            output = parse_output(self._registers[_BINARY[int(parameters[0]) - 1]])
            if output and output.fields and self._last:
                self.send(output.encode(self._last))
        elif command not in _ACCEPTED:
            return _BAD_COMMAND
        return ",".join([command, *parameters])

    def _access(self, command: str, parameters: list[str]) -> str | int:
        """Read or write a register."""
        if not parameters:
            return _TOO_FEW
        if not parameters[0].isdecimal():
            return _BAD_PARAMETER
        number = int(parameters[0])
        if command == "VNWRG":
            return self._write(number, parameters[1:]) or ",".join((command, f"{number:02d}", *parameters[1:]))
        text = f",{self._registers[number]}" if number in self._registers else ""
        if number in MEASURED and self._last and self._has(number):
            text = text_of(number, self._last)
        return f"{command},{number:02d}{text}" if text else _BAD_REGISTER

    def _write(self, number: int, parameters: list[str]) -> int:
        """Write a register; return the number of an error, 0 for none."""
        if number in MEASURED or number in _IDENTITY:
            return _READ_ONLY
        if number not in self._registers:
            return _BAD_REGISTER
        size = self._registers[number].count(",") + 1
        least, most = (1, 2) if number in _OF_PORT else (2, _LARGEST_OUTPUT) if number in _BINARY else (size, size)
        if not least <= len(parameters) <= most:
            return _TOO_FEW if len(parameters) < least else _TOO_MANY
        if not self._is_valid(number, parameters):
            return _BAD_PARAMETER
        if number in _OF_PORT and parameters[1:] == ["2"]:  # which has no wire here
            return 0
        self._registers[number] = ",".join(parameters[:1] if number in _OF_PORT else parameters)
        self._due_ns[_KIND if number in _OF_PORT else number] = 0
        return 0

    def _has(self, number: int) -> bool:
        return self.has_receiver or number not in _WITH_RECEIVER

    def _is_valid(self, number: int, parameters: list[str]) -> bool:
        if number in _OF_PORT:  # the second parameter is the port
            allowed = _OF_PORT[number] or ["0", *[kind for kind, (_, of) in _KINDS.items() if self._has(of)]]
            return parameters[0] in allowed and parameters[1:] in ([], ["1"], ["2"])
        if number in _BINARY:
            return parse_output(",".join(parameters)) is not None
        return number != _PROTOCOL or (parameters[:4] == ["0"] * 4 and parameters[4] in ("1", "3"))

    def on_sample(self, topic: str, stamped: Stamped, now_ns: int) -> None:
        """Send the outputs that are due."""
        sample = stamped.value
        if not isinstance(sample, ImuSample) or stamped.sent_ns < self._silent_until_ns:
            return
        self._last = measurement = self._measure(sample, stamped.sent_ns, now_ns)
        if self._is_paused:
            return
        kind, data = self._registers[_KIND], b""
        if kind != "0" and self._is_due(_KIND, NS_PER_S // int(self._registers[_RATE]), stamped.sent_ns):
            header, number = _KINDS[kind]
            data += sentence(f"VN{header}{text_of(number, measurement)}", self._has_crc)
        for number in _BINARY:
            output = parse_output(self._registers[number])
            if output and output.ports & 1:
                period_ns = NS_PER_S * output.divisor // _INERTIAL_RATE
                data += output.encode(measurement) if self._is_due(number, period_ns, stamped.sent_ns) else b""
        if data:
            self.send(data, measured_ns=stamped.sent_ns)

    def _is_due(self, number: int, period_ns: int, measured_ns: int) -> bool:
        """Return whether an output is due with this sample: the one nearest to its time."""
        half_ns = round(0.5 * NS_PER_S / max(1.0, self.facts.model.rate))
        due_ns = self._due_ns[number] or measured_ns
        if measured_ns + half_ns <= due_ns:
            return False
        self._due_ns[number] = max(due_ns + period_ns, measured_ns + half_ns)
        return True

    def _measure(self, sample: ImuSample, measured_ns: int, now_ns: int) -> Measurement:
        field = self.scene.measure(self._magnetometer, now_ns) if self._magnetometer else None
        x, y, z = field.field if field else (0.0, 0.0, 0.0)  # type: ignore[attr-defined]
        startup_ns = max(0, measured_ns - self._began_ns)
        interval = (startup_ns - self._last.startup_ns) / NS_PER_S if self._last else 0.0
        return Measurement(
            startup_ns, sample.time_ns, sample.orientation, sample.angular_velocity, sample.acceleration,
            (1e4 * x, 1e4 * y, 1e4 * z), self.settings.temperature, self.settings.pressure, interval,
            self._epoch, self._place,
        )  # fmt: skip


class Vn200(Vn100):
    """A VN-200: INS at 40 Hz until configured; its receiver measures five times a second.

    The filter's place and speed are the receiver's. Without a fix it says that it is not tracking, and stays where it
    was: how it would drift is not modelled.
    """

    model_number = "VN-200T-CR"
    default_kind = "22"
    has_receiver = True

    def start(self, now_ns: int) -> None:
        """Build the unit's sensors; a world that is nowhere on the earth has no satellites."""
        super().start(now_ns)
        if self.facts.origin:
            sensor = load_object(SENSORS["gps"].place, "VN-200")
            self._receiver = self.scene.build(sensor.Model(rate=5.0), sensor=sensor)
            self.timers[self._receive] = now_ns

    def _receive(self, due_ns: int, now_ns: int) -> None:
        """Measure place and velocity."""
        self.timers[self._receive] = max(due_ns + _RECEIVER_PERIOD_NS, now_ns)
        fix, state = self.scene.measure(self._receiver, now_ns), self.scene.state(now_ns)
        if isinstance(fix, FixSample) and state:
            velocity = rotate(state.quaternion, self.facts.mounting.velocity(state.nu))
            fix = fix._replace(time_ns=to_wall_ns(now_ns))
            self._epoch = make_epoch(fix, self.facts.origin_altitude, velocity)
            if fix.fix:
                self._place = fix.latitude, fix.longitude, fix.altitude
