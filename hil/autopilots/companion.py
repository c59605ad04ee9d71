"""Exchange MAVLink messages with ArduSub on a separate port, as a companion computer does.

Its estimate is read and compared with the truth. A leak is reported to it, and faults of the sensors that it simulates
itself are set in it. Positions are sent if the scenario says so:

    odometry   ODOMETRY of the navigation solution: position, attitude, velocity
    dvl        VISION_POSITION_DELTA from the DVL's velocities, by which ArduSub updates its position; none without
               bottom lock
    gps        GPS_INPUT of the GPS receiver; no fix under water

Time in the messages is simulation time. Layouts: MAVLink common.xml. ArduPilot reads them in
libraries/GCS_MAVLink/GCS_Common.cpp, libraries/AP_VisualOdom, libraries/AP_GPS/AP_GPS_MAV.cpp.
"""

import contextlib
import errno
import socket
from collections.abc import Sequence
from math import sqrt
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autopilots import hil_messages
from hil.autopilots.contract import EstimateError, Report
from hil.autopilots.estimate import GLOBAL_POSITION, EstimateReader
from hil.autopilots.inputs import SensorInputs
from hil.autopilots.parameter_reader import ParameterReader
from hil.common.clock import NS_PER_S, NS_PER_US
from hil.common.vectors import Vector3
from hil.links.contract import Counters
from hil.links.mavlink.stream import MavlinkStream
from sim.geodesy import TangentPlane
from sim.sensors.extra_samples import FixSample
from sim.sensors.samples import DvlSample, OdometrySample

SYSTEM: int = 1
COMPONENT: int = dialect.MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY
HEARTBEAT_NS = NS_PER_S  # simulation time between heartbeats, attempts to connect, and messages with the origin
MAX_DELTA_NS = NS_PER_S // 2  # greatest time between two DVL samples for a position delta
FULL_CONFIDENCE = 100.0  # %
TOPICS = {"simulated": "", "odometry": "odom", "dvl": "dvl", "gps": "gps"}
ABSURD_M = 100.0  # from the truth, beyond which ArduSub was started elsewhere
WATER = 1 << 29  # sensor bit of leaks in SYS_STATUS, which ArduSub takes from a companion: ArduSub/GCS_MAVLink_Sub.cpp
GPS_UNKNOWN = dialect.GPS_INPUT_IGNORE_FLAG_HDOP | dialect.GPS_INPUT_IGNORE_FLAG_VDOP


class Companion:
    """Connection to ArduPilot's `port`; `origin`: of NED positions, degrees. `parameters` reads ArduPilot's.

    `lost` counts messages that did not fit into the connection's buffer.
    """

    def __init__(
        self, positions: str, inputs: SensorInputs, origin: tuple[float, float], port: int, report: Report,
        parameters: ParameterReader,
    ) -> None:  # fmt: skip
        self.lost = 0
        self._parameters = parameters
        self._simulated: dict[str, float] = {}  # the parameters of simulated sensors as they were sent last
        self._reader = EstimateReader(TangentPlane(*(inputs.origin or (*origin, 0.0))))
        self._is_absurd = False
        self._positions, self._topic = positions, TOPICS[positions]
        self._inputs, self._origin, self._port, self._report = inputs, origin, port, report
        self._socket: socket.socket | None = None
        self._stream = MavlinkStream(SYSTEM, COMPONENT, Counters())
        self._has_origin = self._has_answered = False  # the autopilot has confirmed the origin, has sent anything
        self._heartbeat_due_ns = 0
        self._dvl_ns: int | None = None  # of the last sample with bottom lock

    @property
    def estimate(self) -> EstimateError | None:
        """The error of its newest estimate; None until it is known."""
        return self._reader.error

    def advance(self, time_ns: int, truth: OdometrySample, host: str) -> None:
        """Send the messages due at `time_ns` after the autopilot's start; `host`: where the autopilot runs."""
        is_new = self._topic in self._inputs.fresh
        self._inputs.fresh.clear()
        if time_ns < self._heartbeat_due_ns - HEARTBEAT_NS:  # the autopilot has restarted
            self._heartbeat_due_ns = 0
        if time_ns >= self._heartbeat_due_ns:
            self._heartbeat_due_ns = time_ns + HEARTBEAT_NS
            if self._socket is None:
                self._connect(host)
            needs_origin = self._topic and not self._has_origin
            self._send([_encode_heartbeat(), *([_encode_origin(self._origin)] if needs_origin else [])])
            if self._inputs.leaks:
                self._send([dialect.MAVLink_sys_status_message(WATER, WATER, 0, *[0] * 10)])
            self._send(self._reader.requests(SYSTEM))
            self._send(self._parameters.requests(SYSTEM, self._has_answered))
            if self._has_answered:
                self._send_faults()
        self._receive(truth)
        if is_new and self._socket:
            self._send(self._encode_messages(time_ns // NS_PER_US, truth))

    def close(self) -> None:
        """Close the connection. Closing twice is harmless."""
        if self._socket:
            self._socket.close()
        self._socket = None

    def _encode_messages(self, time_us: int, truth: OdometrySample) -> list[Any]:
        inputs = self._inputs
        if self._positions == "odometry":
            solution = inputs.odometry, inputs.odometry_variances
            return [hil_messages.encode_odometry(time_us, *solution, hil_messages.LOCAL_FRD)]
        if self._positions == "gps":
            return [encode_gps_input(time_us, inputs.fix, inputs.antenna_velocity(truth))]
        dvl, before_ns = inputs.dvl, self._dvl_ns
        self._dvl_ns = dvl.time_ns if dvl.locked else None
        if not dvl.locked or before_ns is None or not 0 < dvl.time_ns - before_ns <= MAX_DELTA_NS:
            return []
        return [encode_position_delta(time_us, dvl, inputs.gyro, dvl.time_ns - before_ns)]

    def _connect(self, host: str) -> None:
        """Begin to connect, without waiting for the connection."""
        opened = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
        opened.setblocking(False)
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if opened.connect_ex((host, self._port)) not in (0, errno.EINPROGRESS):
            opened.close()
            return
        self._socket, self._has_origin, self._simulated = opened, False, {}
        self._stream, self._has_answered = MavlinkStream(SYSTEM, COMPONENT, Counters()), False

    def _send(self, messages: Sequence[Any]) -> None:
        if self._socket is None or not messages:
            return
        packets = b"".join([self._stream.pack(message) for message in messages])
        try:
            if self._socket.send(packets) < len(packets):
                self.lost += 1
        except BlockingIOError:
            self.lost += len(messages)
        except OSError:  # the autopilot has ended, or does not listen yet
            self.close()

    def _receive(self, truth: OdometrySample) -> None:
        """Read the received messages: ArduPilot's estimate, and its confirmation of the origin."""
        with contextlib.suppress(OSError):
            while self._socket:
                data = self._socket.recv(65_536)
                if not data:
                    self.close()
                elif not self._has_answered:
                    self._has_answered = True
                    if self._topic:
                        self._report(f"sending positions ({self._positions}) to ArduPilot's port {self._port}")
                for message in self._stream.unpack(data):
                    self._take(message, truth)

    def _send_faults(self) -> None:
        """Set the parameters of simulated sensors that have changed, at first all of them."""
        values = self._inputs.ardusub_faults(self._positions)
        changed = sorted(values.items() - self._simulated.items())
        self._simulated = values
        kind = dialect.MAV_PARAM_TYPE_REAL32
        self._send([dialect.MAVLink_param_set_message(SYSTEM, 1, name.encode(), x, kind) for name, x in changed])

    def _take(self, message: Any, truth: OdometrySample) -> None:
        self._reader.take(message, truth)
        self._parameters.take(message)
        kind, estimate = message.get_msgId(), self.estimate
        self._has_origin |= kind == dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN
        if kind == GLOBAL_POSITION and estimate and estimate.position > ABSURD_M and not self._is_absurd:
            self._is_absurd = True
            self._report(
                f"ArduSub's position is {estimate.position:.0f} m from the true one, at an altitude of "
                f"{1e-3 * message.alt:.1f} m: start it with the --home of docs/how-to/ardusub.md"
            )


def encode_position_delta(time_us: int, sample: DvlSample, gyro: Vector3, delta_ns: int) -> Any:
    """Return the VISION_POSITION_DELTA message of a DVL's velocity (m/s, FRD) over `delta_ns`; `gyro` in rad/s."""
    seconds = delta_ns / NS_PER_S
    return dialect.MAVLink_vision_position_delta_message(
        time_us, delta_ns // NS_PER_US, [seconds * x for x in gyro], [seconds * x for x in sample.velocity],
        FULL_CONFIDENCE,
    )  # fmt: skip


def encode_gps_input(time_us: int, fix: FixSample, velocity: Vector3) -> Any:
    """Return the GPS_INPUT message of a sample with or without a fix; `velocity` NED in m/s."""
    if not fix.fix:
        return dialect.MAVLink_gps_input_message(
            time_us, 0, GPS_UNKNOWN, 0, 0, dialect.GPS_FIX_TYPE_NO_FIX, 0, 0, *[0.0] * 9, 0
        )
    horizontal, vertical = (sqrt(max(0.0, variance)) for variance in fix.variances)
    return dialect.MAVLink_gps_input_message(
        time_us, 0, 0, 0, 0, dialect.GPS_FIX_TYPE_3D_FIX, round(1e7 * fix.latitude), round(1e7 * fix.longitude),
        fix.altitude, 1.0, 1.0, *velocity, 0.1, horizontal, vertical, 12,
    )  # fmt: skip


def _encode_heartbeat() -> Any:
    kind, autopilot = dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID
    return dialect.MAVLink_heartbeat_message(kind, autopilot, 0, 0, dialect.MAV_STATE_ACTIVE, 3)


def _encode_origin(origin: tuple[float, float]) -> Any:
    latitude, longitude = origin
    return dialect.MAVLink_set_gps_global_origin_message(SYSTEM, round(1e7 * latitude), round(1e7 * longitude), 0)
