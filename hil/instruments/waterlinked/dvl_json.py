"""The DVL's JSON over TCP: one object a line, reports out, commands in and their responses out."""

import json
from typing import Any

from hil.common.clock import NEVER_NS, NS_PER_S, NS_PER_US, to_wall_ns
from hil.instruments.contract import Client
from hil.instruments.waterlinked.dvl_device import DvlDevice
from hil.instruments.waterlinked.dvl_report import Config, DeadReckoning, Report

LONGEST = 65_536  # bytes of a line
VERSIONS = {"2.6.1": "json_v3.1", "2.7.1": "json_v3.2"}  # by the software


class JsonWire:
    """One client of the DVL `dvl`."""

    def __init__(self, dvl: DvlDevice, client: Client) -> None:
        self._dvl, self._client = dvl, client
        self._format = VERSIONS[dvl.software]
        self._unread = b""

    def feed(self, data: bytes, now_ns: int) -> None:
        """Take bytes of the client; lines that are no command are counted."""
        *lines, self._unread = (self._unread + data).split(b"\n")
        if len(self._unread) > LONGEST:
            self._dvl.malformed += 1
            self._unread = b""
        for line in lines:
            if line.strip():
                self._take(line, now_ns)

    def report(self, report: Report, config: Config, now_ns: int) -> bytes:
        """Return a ping's velocities and transducers."""
        vx, vy, vz = report.velocity
        rows = enumerate(report.transducers)
        return self._line(
            {
                "time": report.milliseconds, "vx": vx, "vy": vy, "vz": vz, "fom": report.fom,
                "covariance": report.covariance, "altitude": report.altitude,
                "transducers": [
                    {
                        "id": number, "velocity": one.velocity, "distance": one.distance, "rssi": one.rssi,
                        "nsd": one.nsd, "beam_valid": one.is_valid,
                    }
                    for number, one in rows
                ],
                "velocity_valid": report.is_valid, "status": 0, "format": self._format,
                "type": "velocity_water" if report.is_water else "velocity",
                "time_of_validity": report.validity_us, "time_of_transmission": to_wall_ns(now_ns) // NS_PER_US,
            }
        )  # fmt: skip

    def position(self, reckoning: DeadReckoning, now_ns: int) -> bytes:
        """Return a dead reckoning report."""
        (x, y, z), (roll, pitch, yaw) = reckoning.position, reckoning.angles
        return self._line(
            {
                "ts": to_wall_ns(now_ns) / NS_PER_S, "x": x, "y": y, "z": z, "std": reckoning.std,
                "roll": roll, "pitch": pitch, "yaw": yaw, "type": "position_local", "status": 0,
                "format": self._format,
            }
        )  # fmt: skip

    def tick(self, now_ns: int) -> int:
        """Nothing is due by time."""
        return NEVER_NS

    def _take(self, line: bytes, now_ns: int) -> None:
        try:
            message = json.loads(line)
            command, parameters = message["command"], message.get("parameters") or {}
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            self._dvl.malformed += 1
            return
        if not isinstance(command, str) or not isinstance(parameters, dict):
            self._dvl.malformed += 1
        elif command == "calibrate_gyro":
            self._dvl.calibrate(now_ns, lambda: self._respond(command))
        else:
            try:
                self._respond(command, self._execute(command, parameters))
            except ValueError as error:
                self._respond(command, error=str(error))

    def _execute(self, command: str, parameters: dict[str, Any]) -> Any:
        """Return the result of a command. Raises ValueError, which says why it fails."""
        dvl = self._dvl
        if command == "get_config":
            return dvl.config._asdict()
        if command == "set_config":
            dvl.config = dvl.config.changed(parameters)
        elif command == "reset_dead_reckoning":
            dvl.reset_reckoning()
        elif command == "trigger_ping":
            if not dvl.trigger():
                raise ValueError("trigger queue is full")
        else:
            raise ValueError(f"unknown command {command[:40]}")
        return None

    def _respond(self, command: str, result: Any = None, error: str = "") -> None:
        response = {"response_to": command, "success": not error, "error_message": error, "result": result}
        self._dvl.send(self._line({**response, "format": self._format, "type": "response"}), self._client)

    def _line(self, message: dict[str, Any]) -> bytes:
        return json.dumps(message, separators=(",", ":")).encode() + b"\r\n"
