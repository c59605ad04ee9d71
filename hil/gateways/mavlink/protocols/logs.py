"""Logs by the old protocol (LOG_REQUEST_LIST, LOG_REQUEST_DATA): the files of the folder of logs, newest last."""

import os
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

DATA = 90  # bytes of one LOG_DATA
MAX_LOGS = 200
AT_ONCE = 20  # LOG_DATA between two turns of the gateway
WHOLE = 0xFFFF_FFFF

Partner = tuple[int, int, int]  # peer, system, component


class LogProtocol:
    """Lists and sends the files below `folder`. One transfer at a time; a new one ends it."""

    def __init__(self, folder: str) -> None:
        self._folder = os.path.realpath(folder) if folder else ""
        self._sending: tuple[Partner, Iterator[Any]] | None = None

    def list_logs(self, packet: Any) -> list[Any]:
        """Return LOG_ENTRY of those asked for; one with a count of 0 without logs."""
        logs = self._logs()
        if not logs:
            return [dialect.MAVLink_log_entry_message(0, 0, 0, 0, 0)]
        chosen = [number for number in range(1, len(logs) + 1) if packet.start <= number <= packet.end]
        return [
            dialect.MAVLink_log_entry_message(number, len(logs), len(logs), int(changed), min(size, WHOLE))
            for number in chosen
            for changed, size, _ in [logs[number - 1]]
        ]

    def begin(self, packet: Any, partner: Partner) -> list[Any]:
        """Begin to send a log; an empty LOG_DATA for an unknown one."""
        logs = self._logs()
        if not 1 <= packet.id <= len(logs):
            return [dialect.MAVLink_log_data_message(packet.id, packet.ofs, 0, [0] * DATA)]
        self._sending = partner, _read(logs[packet.id - 1][2], packet.id, packet.ofs, packet.count)
        return []

    def end(self) -> None:
        """Send no more."""
        self._sending = None

    def tick(self) -> tuple[Partner, list[Any]] | None:
        """Return the next messages, and to whom."""
        if self._sending is None:
            return None
        partner, messages = self._sending
        batch = [message for _, message in zip(range(AT_ONCE), messages, strict=False)]
        if len(batch) < AT_ONCE:
            self._sending = None
        return partner, batch

    def _logs(self) -> list[tuple[float, int, str]]:
        """Return time of change (s), size (bytes) and path of each file, oldest first."""
        logs = []
        if self._folder:
            for folder, folders, names in os.walk(self._folder):
                folders.sort()
                for name in sorted(names):
                    path = os.path.join(folder, name)
                    with suppress(OSError):
                        if not os.path.islink(path):
                            logs.append((os.path.getmtime(path), os.path.getsize(path), path))
                if len(logs) > MAX_LOGS:
                    break
        return sorted(logs)[-MAX_LOGS:]


def _read(path: str, number: int, offset: int, count: int) -> Iterator[Any]:
    end = offset + count
    try:
        with open(path, "rb") as file:
            file.seek(offset)
            while offset < end:
                data = file.read(min(DATA, end - offset))
                yield dialect.MAVLink_log_data_message(number, offset, len(data), list(data.ljust(DATA, b"\0")))
                offset += len(data)
                if len(data) < DATA:
                    return
    except OSError:
        yield dialect.MAVLink_log_data_message(number, offset, 0, [0] * DATA)
