"""Read parameters of a running autopilot: compare some with those of the scenario, follow others."""

import struct
from collections import deque
from collections.abc import Callable, Iterable
from math import isclose
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autopilots.contract import Report
from hil.autopilots.parameters import TOLERANCE, Parameters

MAX_LISTED = 8
MAX_REQUESTS = 10  # in a second; ArduPilot's queue has 20
SILENT_BEATS = 30  # seconds without any answer, after which that is reported
INTEGERS = range(dialect.MAV_PARAM_TYPE_UINT8, dialect.MAV_PARAM_TYPE_REAL32)


class ParameterReader:
    """Reader of one autopilot, an "ardupilot" or a "px4".

    `expected` are the parameters of an autopilot that somebody else has started; those that differ are reported once
    with the `remedy`, and so is its silence.
    """

    def __init__(self, autopilot: str, expected: Parameters, remedy: str, report: Report) -> None:
        self._name = {"ardupilot": "ArduSub", "px4": "PX4"}[autopilot]
        self._has_bytes = autopilot == "px4"  # it sends the bytes of integers instead of numbers
        self._expected, self._remedy, self._report = dict(expected), remedy, report
        self._unread = deque(expected)
        self._set: Callable[[str, float], None] | None = None
        self._different: list[str] = []
        self._silent = 0  # calls without any answer

    def follow(self, names: Iterable[str], set_value: Callable[[str, float], None]) -> None:
        """Request these parameters, too; call `set_value` with each value that the autopilot sends.

        An autopilot also sends a value that a ground station has just set.
        """
        self._unread.extend(name for name in names if name not in self._expected)
        self._set = set_value

    def requests(self, system: int, has_answered: bool) -> list[Any]:
        """Return some requests, to be called once a second; `has_answered`: whether it has sent anything yet.

        Report the parameters that differ once all are requested, or that it sends nothing.
        """
        if not has_answered:
            self._silent += 1
            if self._silent == SILENT_BEATS and self._expected:
                self._report(
                    f"{self._name} sends nothing, so its estimate and parameters are not known: {self._remedy}"
                )
            return []
        if not self._unread and self._different:
            listed = ", ".join(self._different[:MAX_LISTED])
            more = f" and {len(self._different) - MAX_LISTED} more" if len(self._different) > MAX_LISTED else ""
            self._report(f"{self._name}: its parameters are not those of this scenario: {listed}{more}: {self._remedy}")
            self._different.clear()
        names = [self._unread.popleft().encode() for _ in range(min(len(self._unread), MAX_REQUESTS))]
        return [dialect.MAVLink_param_request_read_message(system, 1, name, -1) for name in names]

    def take(self, message: Any) -> None:
        """Take one message, if it has the value of a parameter."""
        if message.get_msgId() != dialect.MAVLINK_MSG_ID_PARAM_VALUE:
            return
        name, value = message.param_id, message.param_value
        if self._has_bytes and message.param_type in INTEGERS:
            (value,) = struct.unpack("<i", struct.pack("<f", value))
        if self._set:
            self._set(name, value)
        wanted = self._expected.pop(name, value)  # compared once: what a ground station sets later is its choice
        if not isclose(value, wanted, rel_tol=TOLERANCE, abs_tol=TOLERANCE):
            self._different.append(f"{name} is {value:g}, not {wanted:g}")
