"""PX4 in the loop by MAVLink's HIL messages: SITL over TCP in lockstep, a board over serial or UDP by the clock.

PX4's SITL connects to us and stands still between two HIL_SENSOR. While it boots it answers none of them, so that they
go out by the clock; from its first HIL_ACTUATOR_CONTROLS on each is answered, and simulated time waits for that. A
board stamps samples when they arrive and waits for nothing: with one the simulation goes by the clock.
"""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autopilots import hil_messages as hil
from hil.autopilots.contract import ABSENT_NS, CHECK_NS, STALL_NS, Autopilot, Figures, Outputs, Report
from hil.autopilots.inputs import SensorInputs
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
CLOCK_START_US = 1_000_000  # PX4 takes 0 for no time
TRUTH_PERIOD_NS = NS_PER_S // 50
RC_PERIOD_NS = NS_PER_S // 50
BEAT_NS = NS_PER_S
BEAT_LOST_NS = 3 * NS_PER_S  # a board that sends nothing for so long is lost
UNREADABLE_BYTES = 2000  # that make no packet, before the baud rate is doubted
MOST_READS = 64  # of the wire at once


class Px4(Autopilot):
    """One PX4 at `address`. `inputs` are the sensors of its vehicle. Raises ConfigError, DeviceError."""

    def __init__(self, address: str, inputs: SensorInputs, settings: AutopilotSettings, report: Report) -> None:
        parsed = parse_address(address)
        self.is_sitl = parsed.kind == "tcp"
        self.lockstep = settings.lockstep and self.is_sitl
        self.figures = Figures()
        self._inputs, self._report = inputs, report
        self._rc = settings.rc if self.is_sitl else ()  # a board has a receiver of its own
        self._wire = open_address(address, "device", settings.baud)
        self.name = f"PX4 on {self._wire.name}"
        self._baud = settings.baud
        self._counters = Counters()
        self._period_ns = round(NS_PER_S / settings.rate)
        self._complained_ns = self._sent_ns = now_ns()
        self._is_peer_known = False
        self._forget()

    def _forget(self) -> None:
        """Reset the state for an autopilot that has just connected."""
        self._stream = MavlinkStream(SYSTEM, COMPONENT, self._counters)
        self._due_ns = self._truth_ns = self._rc_ns = self._beat_ns = 0  # of simulation time
        self._locked = self._awaiting = self._stalled = self._has_beaten = False
        self._beat_received_ns = 0
        self._actuator_us = -1
        self._origin: tuple[int, int] | None = None  # simulation and monotonic time at which it came
        self._time_ns = 0

    def fileno(self) -> int:
        """Return the wire's descriptor."""
        return self._wire.fileno()

    @property
    def connected(self) -> bool:
        """Return whether it is there: connected (SITL), or its heartbeat comes (a board)."""
        if self.is_sitl:
            return self._is_peer_known and not self._stalled
        return self._has_beaten and now_ns() - self._beat_received_ns < BEAT_LOST_NS

    def update_sensor(self, topic: str, sample: Any) -> None:
        """Take one sensor sample."""
        self._inputs.update(topic, sample)

    def advance(self, time_ns: int, truth: OdometrySample) -> None:
        """Send HIL_SENSOR when its time has come, with whatever else is new. Raises DeviceError."""
        self._time_ns = time_ns
        if self.is_sitl and (not self._is_peer_known or self._stalled):
            return
        if self._origin is None:
            self._origin = time_ns, now_ns()
        if time_ns < self._due_ns:
            return
        self._due_ns = max(self._due_ns + self._period_ns, time_ns)  # no sample is made up for
        time_us = CLOCK_START_US + time_ns // NS_PER_US
        messages = [hil.sensor(time_us, self._inertial(truth)), *self._extra(time_us, time_ns, truth)]
        packets = b"".join([self._stream.pack(message) for message in messages])
        if self._wire.write(packets) < len(packets):
            self.figures.lost += 1
        self.figures.states += 1
        self._sent_ns = now_ns()
        self._awaiting = self._locked
        self._inputs.fresh.clear()

    def receive(self, now: int) -> Outputs | None:
        """Return the newest outputs. Raises DeviceError."""
        newest = None
        for _ in range(MOST_READS):
            data = self._wire.read()
            self._check_peer()
            if not data:
                break
            self._counters.bytes_in += len(data)
            for message in self._stream.unpack(data):
                self._counters.messages_in += 1
                newest = self._handle_message(message, now) or newest
            if len(data) < READ_SIZE:  # there is no more, and the next look would find the same
                break
        return newest

    def may_step(self) -> bool:
        """Return whether PX4 has answered, or while it boots whether the clock has come as far."""
        if not self.lockstep or not self.connected:
            return True
        if self._locked:
            return not self._awaiting
        if self._origin is None:
            return True
        simulated, began = self._origin
        return self._time_ns - simulated <= now_ns() - began

    def patience_ns(self) -> int:
        """Return a millisecond while it boots, as then nothing comes that one could wait for."""
        return CHECK_NS if self._locked else NS_PER_MS

    def check(self, now: int) -> None:
        """Report that nobody is there, that it stands still, or that what comes cannot be read."""
        if self._awaiting and not self._stalled and now - self._sent_ns > STALL_NS:
            self._stalled = True
            self.figures.stalls += 1
            self._report(
                f"{self.name}: lockstep stalls, no answer for {(now - self._sent_ns) / NS_PER_S:.1f} s: PX4 is stopped "
                "in a debugger, or hangs; its console says more"
            )
        if now - self._complained_ns < ABSENT_NS or (self.connected and (self._locked or self._actuator_us >= 0)):
            return
        self._complained_ns = now
        problem = self._problem()
        if problem:
            self._report(f"{self.name}: {problem}")

    def close(self) -> None:
        """Close the wire."""
        self._wire.close()

    def _problem(self) -> str:
        counters = self._counters
        if self.is_sitl and not self._is_peer_known:
            return "nobody has connected: start PX4's SITL for an underwater vehicle; -i N is [autopilot] instance = N"
        if not counters.messages_in and counters.bytes_in > UNREADABLE_BYTES:
            return (
                f"{counters.bytes_in} bytes came, and no MAVLink packet among them: a wrong baud rate ({self._baud}), "
                "or another program's port"
            )
        if not self.connected:
            return (
                "no heartbeat: check the cable and the port (QGroundControl may have taken it: switch its automatic "
                "connection off), and that PX4 runs MAVLink there"
            )
        return "heartbeats come, but no HIL_ACTUATOR_CONTROLS: it is still booting, or on a board SYS_HITL is not 1"

    def _check_peer(self) -> None:
        """Check whether SITL has connected or disconnected."""
        is_there = self._wire.connected if isinstance(self._wire, TcpWire) else True
        if is_there == self._is_peer_known or not self.is_sitl:
            return
        self._is_peer_known = is_there
        if is_there:
            if self._complained_ns and self._actuator_us >= 0:
                self.figures.resets += 1
            self._forget()
            self._report(f"{self.name}: PX4 has connected; it boots for about 7 s of simulated time")
        else:
            self._awaiting = False
            self._report(f"{self.name}: PX4 has gone; it does not connect again by itself: restart it")
        self._complained_ns = now_ns()

    def _handle_message(self, message: Any, now: int) -> Outputs | None:
        kind = message.get_msgId()
        if kind == dialect.MAVLINK_MSG_ID_HEARTBEAT and message.autopilot != dialect.MAV_AUTOPILOT_INVALID:
            self._has_beaten, self._beat_received_ns = True, now
        if kind != dialect.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS:
            return None
        if not self._has_beaten and not self.is_sitl:
            self._has_beaten = True
        self._beat_received_ns = now
        if message.time_usec < self._actuator_us:
            self.figures.resets += 1
            self._report(
                f"{self.name}: its time goes back by {(self._actuator_us - message.time_usec) / 1e6:.3f} s: "
                "it has restarted"
            )
        elif message.time_usec == self._actuator_us:
            self.figures.duplicates += 1
        self._actuator_us = message.time_usec
        if message.flags & hil.LOCKSTEP and self.lockstep:
            self._locked = True
        if self._stalled:
            self._stalled = False
            self._report(f"{self.name}: it answers again")
        self._awaiting = False
        self.figures.outputs += 1
        return Outputs(hil.pulses_of(message.controls), bool(message.mode & hil.ARMED), now)

    def _inertial(self, truth: OdometrySample) -> hil.Inertial:
        inputs, fresh = self._inputs, self._inputs.fresh
        field = inputs.magnetic_field if "magnetometer" in fresh else None
        if inputs.earth_field is not None:  # no magnetometer is fitted, and PX4 does not fly without
            field = rotate_inverse(truth.orientation, inputs.earth_field)
        moved = "imu" in fresh
        return hil.Inertial(
            inputs.acceleration if moved else None,
            inputs.gyro if moved else None,
            field,
            inputs.pascal if "pressure" in fresh else None,
        )

    def _extra(self, time_us: int, time_ns: int, truth: OdometrySample) -> list[Any]:
        """Return what goes along with a HIL_SENSOR."""
        inputs, messages = self._inputs, list[Any]()
        if "gps" in inputs.fresh:
            messages.append(hil.gps(time_us, inputs.fix, inputs.antenna_velocity(truth)))
        if "odom" in inputs.fresh:
            messages.append(hil.odometry(time_us, inputs.odometry))
        if inputs.plane is not None and time_ns >= self._truth_ns:
            self._truth_ns = time_ns + TRUTH_PERIOD_NS
            place, velocity = inputs.plane.geodetic(truth.position), rotate(truth.orientation, truth.nu[:3])
            messages.append(hil.truth_state(time_us, truth, velocity, inputs.acceleration, place))
        if self._rc and time_ns >= self._rc_ns:
            self._rc_ns = time_ns + RC_PERIOD_NS
            messages.append(hil.receiver(time_us, self._rc))
        if not self._has_beaten or time_ns >= self._beat_ns:
            self._beat_ns = time_ns + BEAT_NS
            kind, autopilot = dialect.MAV_TYPE_GENERIC, dialect.MAV_AUTOPILOT_INVALID
            messages.append(dialect.MAVLink_heartbeat_message(kind, autopilot, 0, 0, dialect.MAV_STATE_ACTIVE, 3))
        return messages
