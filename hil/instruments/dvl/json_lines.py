"""The DVL's JSON over TCP: one object a line, reports out, commands in and their responses out."""

import json
from typing import Any

from hil.common.clock import NS_PER_S, NS_PER_US, to_wall_ns
from hil.common.errors import ConfigError
from hil.instruments.dvl.device import DvlWire
from hil.instruments.dvl.report import Report

VERSIONS = {"2.6.1": "json_v3.1", "2.7.1": "json_v3.2"}  # by the software


class JsonWire(DvlWire):
    """One client."""

    def feed(self, data: bytes, now_ns: int) -> None:
        """Take bytes of the client; lines that are no command are counted."""
        for line in filter(bytes.strip, self._lines.read(data)):
            self._take(line, now_ns)

    def report(self, report: Report, now_ns: int) -> bytes:
        """Return a ping's velocities and transducers."""
        vx, vy, vz = report.velocity
        fields = {
            "time": report.milliseconds, "vx": vx, "vy": vy, "vz": vz, "fom": report.fom,
            "covariance": report.covariance, "altitude": report.altitude,
            "transducers": [{"id": number, **one._asdict()} for number, one in enumerate(report.transducers)],
            "velocity_valid": report.is_valid, "status": 0,
            "time_of_validity": report.validity_us, "time_of_transmission": to_wall_ns(now_ns) // NS_PER_US,
        }  # fmt: skip
        return self._line("velocity_water" if report.is_water else "velocity", fields)

    def position(self, now_ns: int) -> bytes:
        """Return a dead reckoning report."""
        reckoning = self._dvl.reckoning
        place = dict(zip(("x", "y", "z"), reckoning.position, strict=True))
        angles = dict(zip(("roll", "pitch", "yaw"), reckoning.angles, strict=True))
        fields = {"ts": to_wall_ns(now_ns) / NS_PER_S, **place, "std": reckoning.std, **angles, "status": 0}
        return self._line("position_local", fields)

    def _take(self, line: bytes, now_ns: int) -> None:
        """Execute a command, and respond."""
        try:
            message = json.loads(line)
            command, parameters = message["command"], message.get("parameters") or {}
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            command = parameters = None
        if not isinstance(command, str) or not isinstance(parameters, dict):
            self._dvl.malformed += 1
        elif command == "calibrate_gyro":
            self._dvl.calibrate(now_ns, lambda: self._respond(command))
        else:
            try:
                self._respond(command, self._execute(command, parameters))
            except ConfigError as error:
                self._respond(command, error=str(error))

    def _execute(self, command: str, parameters: dict[str, Any]) -> Any:
        """Return the result of a command. Raises ConfigError, which says why it fails."""
        dvl = self._dvl
        if command == "get_config":
            return dvl.kept.config._asdict()
        if command == "set_config":
            dvl.kept.config = dvl.kept.config.changed(parameters)
        elif command == "reset_dead_reckoning":
            dvl.reset_reckoning()
        elif command != "trigger_ping":
            raise ConfigError(f"unknown command {command[:40]}")
        elif not dvl.trigger():
            raise ConfigError("trigger queue is full")
        return None

    def _respond(self, command: str, result: Any = None, error: str = "") -> None:
        response = {"response_to": command, "success": not error, "error_message": error, "result": result}
        self._dvl.send(self._line("response", response), self._client)

    def _line(self, kind: str, fields: dict[str, Any]) -> bytes:
        message = {**fields, "format": VERSIONS[self._dvl.settings.software], "type": kind}
        return json.dumps(message, separators=(",", ":")).encode() + b"\r\n"
