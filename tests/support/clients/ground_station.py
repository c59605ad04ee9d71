"""A ground station for tests: it speaks MAVLink to an autopilot over TCP or UDP, in simulated time.

A test flies an `AutopilotRun` step by step. Its mission is a generator that yields the simulated time (s) until which
it waits, or a condition to wait for; the ground station is polled meanwhile.
"""

import contextlib
import socket
import time
from collections.abc import Callable, Iterator
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autopilots.run import AutopilotRun
from hil.links.contract import Counters
from hil.links.mavlink.stream import MavlinkStream

POLL_S = 0.05  # of simulated time
Wait = float | Callable[[], bool]
Mission = Iterator[Wait]


class GroundStation:
    """One ground station, system 255. `sticks` are x, y, z, r of MANUAL_CONTROL; None: none are sent."""

    def __init__(self, address: tuple[str, int], datagrams: bool = False) -> None:
        self._address, self._datagrams = address, datagrams
        self._socket: socket.socket | None = None
        self._stream = MavlinkStream(255, 190, Counters())
        self._remote: tuple[str, int] | None = None
        self._beat = self._sent = -1.0
        self.now = 0.0
        self.has_heartbeat = True
        self.sticks: tuple[int, int, int, int] | None = (0, 0, 500, 0)
        self.latest: dict[str, Any] = {}
        self.texts: list[tuple[float, str]] = []
        self.acks: dict[int, int] = {}
        self.every: Callable[[], None] | None = None  # called with each MANUAL_CONTROL

    def close(self) -> None:
        if self._socket:
            self._socket.close()

    def send(self, message: Any) -> None:
        if self._socket is None:
            return
        data = self._stream.pack(message)
        with contextlib.suppress(OSError):
            if not self._datagrams:
                self._socket.sendall(data)
            elif self._remote:
                self._socket.sendto(data, self._remote)

    def command(self, number: int, *parameters: float) -> None:
        self.acks.pop(number, None)
        filled = [*parameters, *[0.0] * (7 - len(parameters))]
        self.send(dialect.MAVLink_command_long_message(1, 1, number, 0, *filled))

    def set_parameter(self, name: str, value: float, kind: int = dialect.MAV_PARAM_TYPE_REAL32) -> None:
        self.send(dialect.MAVLink_param_set_message(1, 1, name.encode(), value, kind))

    def output(self, text_part: str) -> bool:
        return any(text_part in text for _, text in self.texts)

    def poll(self, now: float) -> None:
        self.now = now
        if self._socket is None and not self._connect():
            return
        if self.has_heartbeat and now - self._beat >= 1.0:
            self._beat = now
            self.send(dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
        if now - self._sent >= 0.1 - 1e-9:
            self._sent = now
            if self.sticks:
                self.send(dialect.MAVLink_manual_control_message(1, *self.sticks, 0))
            if self.every:
                self.every()
        self._receive()

    def _connect(self) -> bool:
        try:
            if self._datagrams:
                self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                self._socket.bind(self._address)
            else:
                self._socket = socket.create_connection(self._address, 1.0)
        except OSError:
            return False
        self._socket.setblocking(False)
        return True

    def _receive(self) -> None:
        assert self._socket
        while True:
            try:
                data, sender = self._socket.recvfrom(65_536)
            except OSError:
                return
            if not data:
                return
            self._remote = sender if self._datagrams else None
            for message in self._stream.unpack(data):
                if message.get_srcComponent() == 1:
                    self._on_message(message)

    def _on_message(self, message: Any) -> None:
        name = message.get_type() if hasattr(message, "get_type") else "SERVO_OUTPUT_RAW"
        self.latest[name] = message
        if name == "STATUSTEXT":
            self.texts.append((self.now, message.text))
        elif name == "COMMAND_ACK":
            self.acks[message.command] = message.result
        elif name == "PARAM_VALUE":
            self.latest[f"PARAM {message.param_id}"] = message.param_value


def fly(run: AutopilotRun, station: GroundStation, mission: Mission, limit: float) -> None:
    """Step the run until the mission ends; fail when simulated time exceeds `limit` s."""
    mission_run = _MissionRun(station, mission, limit)
    due = 0.0
    while True:
        run.step()
        now = run.simulation.time_ns / 1e9
        if now >= due:
            due = now + POLL_S
            if mission_run.is_over(now):
                return


def fly_live(station: GroundStation, mission: Mission, limit: float) -> None:
    """Fly an autopilot in real time whose vehicle is another process; fail after `limit` s."""
    mission_run, began = _MissionRun(station, mission, limit), time.monotonic()
    while not mission_run.is_over(time.monotonic() - began):
        time.sleep(POLL_S)


class _MissionRun:
    """A mission and the condition that it waits for."""

    def __init__(self, station: GroundStation, mission: Mission, limit: float) -> None:
        self._station, self._mission, self._limit = station, mission, limit
        self._wait: Wait = 0.0

    def is_over(self, now: float) -> bool:
        """Poll the ground station; continue the mission when its condition is true; return whether it has ended."""
        self._station.poll(now)
        assert now < self._limit, f"{now:.1f} s: still waiting; texts: {self._station.texts[-5:]}"
        wait = self._wait
        if wait() if callable(wait) else now >= wait:
            try:
                wait = next(self._mission)
            except StopIteration:
                return True
            self._wait = wait if callable(wait) else now + wait
        return False
