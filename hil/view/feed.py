"""What the page shows now: values by key, the log, and pictures. Each browser gets what has changed since its last."""

import json
import threading
from collections import deque
from collections.abc import Callable, Collection, Mapping
from datetime import datetime
from math import isfinite
from typing import Any, Literal, NamedTuple

LOG_LINES = 300
DIGITS = 5  # of numbers after the point: more than any sensor has

Severity = Literal["info", "warning", "error"]


class Encoded(NamedTuple):
    """A picture as bytes with the words that describe it."""

    header: dict[str, Any]
    data: bytes


class Feed:
    """The newest values. Any thread may set them; each has the version of its last change.

    `begin` returns what only a browser without any version gets: what it then continues by itself.
    """

    def __init__(self, begin: Callable[[], Mapping[str, Any]] = dict) -> None:
        self._begin = begin
        self._lock = threading.Lock()
        self._version = 0
        self._values: dict[str, tuple[int, str]] = {}
        self._pictures: dict[str, tuple[int, Encoded]] = {}
        self._log = deque[tuple[int, str]](maxlen=LOG_LINES)

    def set(self, key: str, value: Any) -> None:
        """Set a value; numbers that are not finite become null."""
        text = json.dumps(_plain(value), separators=(",", ":"))
        with self._lock:
            if self._values.get(key, (0, ""))[1] != text:
                self._version += 1
                self._values[key] = self._version, text

    def add_log_line(self, text: str, severity: Severity = "info") -> None:
        """Add a line to the log, with the time of day."""
        line = json.dumps([datetime.now().strftime("%H:%M:%S"), severity, text])
        with self._lock:
            self._version += 1
            self._log.append((self._version, line))

    def set_picture(self, key: str, picture: Encoded) -> None:
        """Set the newest picture of a camera or a sonar."""
        with self._lock:
            self._version += 1
            self._pictures[key] = self._version, picture

    def changes(self, since: int) -> tuple[int, str]:
        """Return the present version, and as JSON what has changed after the version `since`."""
        begin = {} if since else self._begin()
        with self._lock:
            values = [f"{json.dumps(key)}:{json.dumps(_plain(each))}" for key, each in begin.items()]
            values += [f"{json.dumps(key)}:{text}" for key, (at, text) in self._values.items() if at > since]
            lines = [line for at, line in self._log if at > since]
            return self._version, f'{{"log":[{",".join(lines)}],"values":{{{",".join(values)}}}}}'

    def pictures(self, keys: Collection[str], since: int) -> list[Encoded]:
        """Return those of the pictures `keys` that are newer than the version `since`."""
        with self._lock:
            return [picture for key, (at, picture) in self._pictures.items() if key in keys and at > since]


def pack(header: dict[str, Any], data: bytes) -> bytes:
    """Return the length of the header (4 bytes), the header as JSON, padded to a multiple of 4 bytes, and the data."""
    text = json.dumps(_plain(header), separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    return len(text).to_bytes(4, "little") + text + data


def _plain(value: Any) -> Any:
    """Return a value that JSON can carry."""
    if isinstance(value, float):
        return round(value, DIGITS) if isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    if hasattr(value, "tolist"):  # of numpy
        return _plain(value.tolist())
    return value
