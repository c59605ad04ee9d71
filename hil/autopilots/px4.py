"""PX4 in the loop over MAVLink's HIL messages: SITL over TCP in lockstep, a board over serial or UDP in real time.

PX4's SITL connects to this process and waits for each HIL_SENSOR. While it boots it does not reply, so HIL_SENSOR is
sent by the clock. From its first HIL_ACTUATOR_CONTROLS on it replies to each HIL_SENSOR, and simulation time waits for
the reply. A board stamps samples on arrival and waits for nothing, so the simulation runs in real time.

With GPS, PX4's estimator takes where it starts for the origin of its positions, unless SET_GPS_GLOBAL_ORIGIN sets that
of the world. SITL reads this message, and sends its estimate, at its port for a camera only. It answers the first
sender there, so the port for companion computers is left to them.
"""

import socket
from contextlib import suppress
from math import nan
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autopilots import hil_messages
from hil.autopilots.contract import (
    ABSENT_NS,
    CHECK_NS,
    STALL_NS,
    Autopilot,
    AutopilotCounters,
    EstimateError,
    Outputs,
    Report,
)
from hil.autopilots.estimate import EstimateReader
from hil.autopilots.inputs import SensorInputs
from hil.autopilots.parameter_reader import ParameterReader
from hil.common.clock import NS_PER_MS, NS_PER_S, NS_PER_US, now_ns
from hil.links.address import open_address, parse_address
from hil.links.contract import Counters
from hil.links.mavlink.stream import MavlinkStream
from hil.links.wires.net import TcpWire
from hil.links.wires.terminal import READ_SIZE
from hil.scenario.autopilot_records import AutopilotSettings
from sim.rotations import rotate, rotate_inverse
from sim.sensors.samples import OdometrySample

SYSTEM, COMPONENT = 1, 200
CLOCK_START_US = 1_000_000  # to PX4 a time of 0 is no time
TRUTH_PERIOD_NS = NS_PER_S // 50
HEARTBEAT_NS = NS_PER_S
HEARTBEAT_TIMEOUT_NS = 3 * NS_PER_S  # without messages, after which a board is not connected
UNREADABLE_BYTES = 2000  # received without any packet, after which a wrong baud rate is reported
BOOT_NS = 30 * NS_PER_S  # without outputs of a connected PX4, after which that is reported; 11 s are usual
MAX_READS = 64  # of the wire in one call of `receive`
CAMERA_PORT = 14_280  # of the first SITL instance
ORIGIN_MESSAGES = 5  # one a second: the first ones are lost if PX4's estimator does not run yet
DITHER_T = 1e-8  # last digit of a usual magnetometer; PX4 takes a value that never changes for a failed sensor
TOPICS = {"simulated": "odom", "odometry": "odom", "dvl": "dvl", "gps": "pressure"}  # sent as ODOMETRY


class Px4(Autopilot):
    """Connection to one PX4 at `address`. `inputs`: sensors of its vehicle. `parameters` reads those of PX4.

    Raises ConfigError, DeviceError.
    """

    def __init__(
        self, address: str, inputs: SensorInputs, settings: AutopilotSettings, report: Report,
        parameters: ParameterReader,
    ) -> None:  # fmt: skip
        parsed = parse_address(address)
        self.is_sitl = parsed.kind == "tcp"
        self.lockstep = settings.lockstep and self.is_sitl
        self.figures = AutopilotCounters()
        self._inputs, self._report, self._parameters = inputs, report, parameters
        self._positions = TOPICS[settings.positions]
        self._camera_address = "127.0.0.1", CAMERA_PORT + settings.instance
        self._dither = DITHER_T
        self._wire = open_address(address, "device", settings.baud)
        self._camera = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._camera.setblocking(False)
        self.name = f"PX4 on {self._wire.name}"
        self._baud = settings.baud
        self._counters = Counters()
        self._period_ns = round(NS_PER_S / settings.rate)
        self._reported_ns = self.sent_ns = now_ns()
        self._is_peer_connected = False
        self._reset_connection()

    def _reset_connection(self) -> None:
        """Reset the state for an autopilot that has just connected."""
        self._stream = MavlinkStream(SYSTEM, COMPONENT, self._counters)
        self._camera_stream = MavlinkStream(SYSTEM, COMPONENT, Counters())
        # From velocities alone PX4 counts its position from where it starts.
        self._start = self._inputs.start if self._positions == "dvl" else (0.0, 0.0, 0.0)
        self._reader = EstimateReader(self._inputs.plane, self._start)
        self._truth: OdometrySample | None = None
        self._due_ns = self._truth_ns = self._heartbeat_due_ns = 0  # of simulation time
        self._is_in_lockstep = self._awaiting = self._stalled = self._has_heartbeat = False
        self._heartbeat_received_ns = 0
        self._actuator_us, self._system = -1, 1
        # By GPS alone PX4 has no position before the first fix; an origin would then move it to latitude 0.
        self._origins_left = ORIGIN_MESSAGES if self._inputs.plane and self._positions != "pressure" else 0
        self._origin: tuple[int, int] | None = None  # simulation and monotonic time of the first step with it
        self._time_ns = 0

    def fileno(self) -> int:
        """Return the wire's descriptor."""
        return self._wire.fileno()

    @property
    def connected(self) -> bool:
        """Return whether SITL is connected and not stalled, or a board has sent messages within the timeout."""
        if self.is_sitl:
            return self._is_peer_connected and not self._stalled
        return self._has_heartbeat and now_ns() - self._heartbeat_received_ns < HEARTBEAT_TIMEOUT_NS

    @property
    def estimate(self) -> EstimateError | None:
        """The error of its newest estimate."""
        return self._reader.error

    def advance(self, time_ns: int, truth: OdometrySample) -> None:
        """Send HIL_SENSOR if it is due, with other new data. Raises DeviceError."""
        self._time_ns, self._truth = time_ns, truth
        self._inputs.expire(time_ns)
        with suppress(OSError):  # nothing has come, or SITL does not listen yet
            while self.is_sitl:
                for message in self._camera_stream.unpack(self._camera.recv(READ_SIZE)):
                    self._read(message, truth)
        if self.is_sitl and (not self._is_peer_connected or self._stalled):
            return
        if self._origin is None:
            self._origin = time_ns, now_ns()
        if time_ns < self._due_ns:
            return
        self._due_ns = max(self._due_ns + self._period_ns, time_ns)  # missed messages are not sent later
        time_us = CLOCK_START_US + time_ns // NS_PER_US
        messages = [self._encode_sensor(time_us, truth), *self._extra(time_us, time_ns, truth)]
        packets = b"".join([self._stream.pack(message) for message in messages])
        self.sent_ns = now_ns()
        if self._wire.write(packets) < len(packets):
            self.figures.lost += 1
        self.figures.states += 1
        self._awaiting = self._is_in_lockstep
        self._inputs.fresh.clear()

    def receive(self, now: int) -> Outputs | None:
        """Return the newest outputs. Raises DeviceError."""
        newest = None
        for _ in range(MAX_READS):
            data = self._wire.read()
            self._check_peer()
            if not data:
                break
            self._counters.bytes_in += len(data)
            for message in self._stream.unpack(data):
                self._counters.messages_in += 1
                newest = self._handle_message(message, now) or newest
            if len(data) < READ_SIZE:  # all is read
                break
        return newest

    def may_step(self) -> bool:
        """Return whether PX4 has replied; while it boots, whether simulation time is not ahead of the clock."""
        if not self.lockstep or not self.connected:
            return True
        if self._is_in_lockstep:
            return not self._awaiting
        if self._origin is None:
            return True
        simulated, began = self._origin
        return self._time_ns - simulated <= now_ns() - began

    def wait_limit_ns(self) -> int:
        """Return 1 ms while it boots: its descriptor does not become readable then."""
        return CHECK_NS if self._is_in_lockstep else NS_PER_MS

    def check(self, now: int) -> None:
        """Report if PX4 is not connected, has stalled in lockstep, or sends data that cannot be read."""
        if self._awaiting and not self._stalled and now - self.sent_ns > STALL_NS:
            self._stalled = True
            self.figures.stalls += 1
            self._report(
                f"{self.name}: lockstep stalls, no reply for {(now - self.sent_ns) / NS_PER_S:.1f} s: PX4 is stopped "
                "in a debugger, or hangs; read its console"
            )
        limit_ns = BOOT_NS if self.connected else ABSENT_NS
        if now - self._reported_ns < limit_ns or (self.connected and self._actuator_us >= 0):
            return
        self._reported_ns = now
        problem = self._connection_fault()
        if problem:
            self._report(f"{self.name}: {problem}")

    def close(self) -> None:
        """Close the wire."""
        self._wire.close()
        self._camera.close()

    def _connection_fault(self) -> str:
        counters = self._counters
        if self.is_sitl and not self._is_peer_connected:
            return (
                "nobody has connected: start PX4's SITL for an underwater vehicle, with -i N for "
                "[autopilot] instance = N"
            )
        if not counters.messages_in and counters.bytes_in > UNREADABLE_BYTES:
            return (
                f"{counters.bytes_in} bytes received, but no MAVLink packet: the baud rate ({self._baud}) is wrong, or "
                "the port is another program's"
            )
        if not self.connected:
            return (
                "no heartbeat: check the cable and the port (QGroundControl may use it: switch its automatic "
                "connection off), and that PX4 runs MAVLink on it"
            )
        return "heartbeats, but no HIL_ACTUATOR_CONTROLS: PX4 is still booting, or on a board SYS_HITL is not 1"

    def _check_peer(self) -> None:
        """Report if SITL has connected or disconnected."""
        is_connected = self._wire.connected if isinstance(self._wire, TcpWire) else True
        if is_connected == self._is_peer_connected or not self.is_sitl:
            return
        self._is_peer_connected = is_connected
        if is_connected:
            if self._reported_ns and self._actuator_us >= 0:
                self.figures.resets += 1
            self._reset_connection()
            self._report(f"{self.name}: PX4 has connected; it boots for 7 to 11 s of simulated time")
        else:
            self._awaiting = False
            self._report(f"{self.name}: PX4 has disconnected; it does not connect again by itself: restart it")
        self._reported_ns = now_ns()

    def _handle_message(self, message: Any, now: int) -> Outputs | None:
        kind = message.get_msgId()
        if kind == dialect.MAVLINK_MSG_ID_HEARTBEAT and message.autopilot != dialect.MAV_AUTOPILOT_INVALID:
            self._has_heartbeat, self._heartbeat_received_ns = True, now
        if self._truth and not self.is_sitl:
            self._read(message, self._truth)
        if kind != dialect.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS:
            return None
        if not self._has_heartbeat and not self.is_sitl:
            self._has_heartbeat = True
        self._heartbeat_received_ns = now
        if message.time_usec < self._actuator_us:
            self.figures.resets += 1
            self._report(
                f"{self.name}: its time went back by {(self._actuator_us - message.time_usec) / 1e6:.3f} s: "
                "it has restarted"
            )
        elif message.time_usec == self._actuator_us:
            self.figures.duplicates += 1
        self._actuator_us, self._system = message.time_usec, message.get_srcSystem()
        if message.flags & hil_messages.LOCKSTEP and self.lockstep:
            self._is_in_lockstep = True
        if self._stalled:
            self._stalled = False
            self._report(f"{self.name}: it replies again")
        self._awaiting = False
        self.figures.outputs += 1
        return Outputs(hil_messages.controls_to_pwm(message.controls), bool(message.mode & hil_messages.ARMED), now)

    def _read(self, message: Any, truth: OdometrySample) -> None:
        """Take a message of PX4's estimate or parameters."""
        self._reader.take(message, truth)
        self._parameters.take(message)

    def _encode_sensor(self, time_us: int, truth: OdometrySample) -> Any:
        inputs, fresh = self._inputs, self._inputs.fresh
        field = inputs.magnetic_field if "magnetometer" in fresh else None
        if inputs.earth_field is not None:  # the vehicle has no magnetometer, but PX4 needs one
            self._dither = -self._dither
            x, y, z = rotate_inverse(truth.orientation, inputs.earth_field)
            field = x + self._dither, y + self._dither, z + self._dither
        has_imu = "imu" in fresh
        pascal = inputs.pascal if "pressure" in fresh else None
        acceleration, gyro = (inputs.acceleration, inputs.gyro) if has_imu else (None, None)
        return hil_messages.encode_sensor(time_us, acceleration, gyro, field, pascal)

    def _extra(self, time_us: int, time_ns: int, truth: OdometrySample) -> list[Any]:
        """Return the other messages to send with a HIL_SENSOR."""
        inputs, messages = self._inputs, list[Any]()
        if "gps" in inputs.fresh:
            messages.append(hil_messages.encode_gps(time_us, inputs.fix, inputs.antenna_velocity(truth)))
        if self._positions in inputs.fresh:
            messages.append(self._encode_positions(time_us))
        if inputs.plane is not None and time_ns >= self._truth_ns:
            self._truth_ns = time_ns + TRUTH_PERIOD_NS
            place, velocity = inputs.plane.geodetic(truth.position), rotate(truth.orientation, truth.nu[:3])
            messages.append(hil_messages.encode_truth(time_us, truth, velocity, inputs.acceleration, place))
        if not self._has_heartbeat or time_ns >= self._heartbeat_due_ns:
            self._heartbeat_due_ns = time_ns + HEARTBEAT_NS
            kind, autopilot = dialect.MAV_TYPE_GENERIC, dialect.MAV_AUTOPILOT_INVALID
            messages.append(dialect.MAVLink_heartbeat_message(kind, autopilot, 0, 0, dialect.MAV_STATE_ACTIVE, 3))
            if self._actuator_us >= 0:
                messages += self._beside()
        return messages

    def _encode_positions(self, time_us: int) -> Any:
        inputs = self._inputs
        if self._positions == "odom":
            return hil_messages.encode_odometry(time_us, inputs.odometry, inputs.odometry_variances)
        if self._positions == "pressure":
            return hil_messages.encode_velocity(time_us, inputs.depth, None)
        depth = nan if "pressure" in inputs.missing else inputs.depth + inputs.dvl_below
        return hil_messages.encode_velocity(time_us, depth, inputs.dvl)

    def _beside(self) -> list[Any]:
        """Send SITL the origin, and requests of its estimate and parameters; for a board, return them."""
        messages, plane = self._reader.requests(self._system), self._inputs.plane
        messages += self._parameters.requests(self._system, self._reader.error is not None)
        if plane and self._origins_left:
            self._origins_left -= 1
            latitude, longitude, altitude = plane.geodetic(self._start)
            place = round(1e7 * latitude), round(1e7 * longitude), round(1000.0 * altitude)
            messages.append(dialect.MAVLink_set_gps_global_origin_message(self._system, *place))
        if not self.is_sitl:
            return messages
        for message in messages:
            with suppress(OSError):
                self._camera.sendto(self._camera_stream.pack(message), self._camera_address)
        return []
