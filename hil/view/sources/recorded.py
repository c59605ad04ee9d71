"""Samples of a recording, for the live view: at any instant the newest message of each topic."""

from bisect import bisect_right
from collections.abc import Mapping
from typing import Any

from hil.common.clock import NS_PER_S
from hil.common.errors import ConfigError
from hil.recording.reader import read_messages
from hil.ros import encoders as ros
from hil.ros.diagnostics import Diagnostics
from hil.view.sources.paced_time import PacedTime
from hil.view.sources.source import Source

LARGEST = 2 << 30  # bytes of messages in memory


class _TopicMessages:
    """The messages of one topic of one vehicle, in the order of their times."""

    def __init__(self) -> None:
        self.times: list[int] = []
        self._payloads: list[bytes] = []
        self._decoded: tuple[int, Any] = (-1, None)

    def append(self, time_ns: int, payload: bytes) -> None:
        """Add a message that is not older than the last."""
        self.times.append(max(time_ns, self.times[-1] if self.times else 0))
        self._payloads.append(payload)

    def at(self, topic: str, time_ns: int) -> Any:
        """Return the newest message at that time, decoded; None without one, or if it is malformed."""
        index = bisect_right(self.times, time_ns) - 1
        if index < 0:
            return None
        if self._decoded[0] != index:
            decode = ros.decoder(topic)
            self._decoded = index, decode(self._payloads[index]) if decode else None
        return self._decoded[1]


class RecordedSource(Source):
    """The vehicles of a recording (a file or a folder). Raises ConfigError, MissingExtraError."""

    def __init__(self, path: str) -> None:
        self._messages: dict[str, dict[str, _TopicMessages]] = {}
        first, last, size = 0, 0, 0
        for message in read_messages(path):
            _, node, *suffix = message.topic.split("/", 2)
            if not suffix or ros.decoder(suffix[0]) is None:
                continue
            size += len(message.data)
            if size > LARGEST:
                raise ConfigError(f"{path}: more than {LARGEST >> 30} GiB of messages; cut it, or show a part of it")
            first, last = first or message.logged_ns, max(last, message.logged_ns)
            self._messages.setdefault(node, {}).setdefault(suffix[0], _TopicMessages()).append(
                message.logged_ns, message.data
            )
        if not self._messages:
            raise ConfigError(f"{path}: no messages of a vehicle in it")
        self._first_ns = first
        self.playback: PacedTime = PacedTime((last - first) / NS_PER_S)

    @property
    def names(self) -> list[str]:
        """Names of the vehicles that were recorded."""
        return sorted(self._messages)

    def is_present(self, name: str) -> bool:
        """Return True if the vehicle has sent a sample by the shown time."""
        return any(messages.times[0] <= self._now_ns for messages in self._messages[name].values())

    def latest(self, name: str) -> Mapping[str, Any]:
        """Return the newest sample of each topic at the shown time."""
        now_ns = self._now_ns
        values = {topic: messages.at(topic, now_ns) for topic, messages in self._messages[name].items()}
        return {topic: value for topic, value in values.items() if value is not None}

    def diagnostics(self, name: str) -> Diagnostics:
        """Return the diagnostics at the shown time."""
        messages = self._messages[name].get("diagnostics")
        value = messages.at("diagnostics", self._now_ns) if messages else None
        return Diagnostics(value[0][3] if value else {})

    @property
    def _now_ns(self) -> int:
        return self._first_ns + round(self.playback.time * NS_PER_S)
