"""Record without blocking the caller: a separate thread writes the messages.

A recording is a folder of MCAP files with an index, which is also a rosbag2 bag. Messages are written to disk within a
second, in the order of their log times, because readers need that order in a file without an index (after a crash). A
file at its size limit is closed, and a new one is begun. When all files together reach their limit, the oldest are
deleted. If the disk is full or any error occurs, recording ends and reports why; the run continues.
"""

import os
import threading
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from operator import attrgetter

from hil.common import __version__
from hil.common.clock import NEVER_NS, NS_PER_S, boot_id, now_ns, to_wall_ns
from hil.common.errors import ConfigError
from hil.common.schema import find_preset
from hil.recording.index import write_index
from hil.recording.mcap_file import CLOCK_SHIFT, FileSummary, Message
from hil.recording.mcap_writer import RecordingFile, require_library
from hil.ros.encoders import encode_int64_array
from hil.scenario.config import Scenario
from hil.scenario.records import Recording

DRAIN_PERIOD_S = 0.1
FLUSH_PERIOD_NS = 8 * NS_PER_S // 10  # with HOLD_NS less than a second, the most that a crash loses
INDEX_PERIOD_NS = 10 * NS_PER_S
HOLD_NS = NS_PER_S // 10  # messages are held so long to sort them; longer than from log time to recorder
PLAUSIBLE_NS = 60 * NS_PER_S  # greatest age of a message that the recorder receives
MAX_WAITING = 100_000  # messages; enough for ten vehicles while a disk is busy for ten seconds
MAX_WAITING_BYTES = 1 << 28  # the limit that pictures reach first
_MIB = 1 << 20
_FULL = 0.85  # share of a file's size limit; the rest is for its index

Report = Callable[[str], None]
Source = Callable[[], Sequence[Message]]
_log_time = attrgetter("logged_ns")


def new_folder(name: str, root: str = "runs") -> str:
    """Make and return a folder in `root` for a run or a recording that begins now: NAME-DATE-TIME.

    Two recordings that begin in the same second get different folders. `name` may be a path; its folder and extension
    are left out. Raises ConfigError if the folder cannot be made.
    """
    stem = os.path.splitext(os.path.basename(name))[0]
    folder = first = os.path.join(root, f"{stem}-{time.strftime('%Y%m%d-%H%M%S')}")
    number = 1
    while True:
        try:
            os.makedirs(folder)
            return folder
        except FileExistsError:
            number += 1
            folder = f"{first}-{number}"
        except OSError as error:
            raise ConfigError(f"{folder}: cannot be made: {error.strerror}; choose another folder") from None


class Recorder:
    """Records into `folder`, which it makes, until `close`. Use as a context.

    `about` and `attachments` (name -> text) are at the beginning of every file. `source` is called ten times a second,
    and at the end, and returns new messages; this costs less than a `put` of each. `report` is called if recording
    ends early. Both are called in the recorder's thread. `written` counts messages, `lost` those that came faster than
    the disk could store them. `failure` is why recording ended early. Raises ConfigError, MissingExtraError.
    """

    def __init__(
        self,
        folder: str,
        options: Recording,
        about: dict[str, str],
        attachments: dict[str, str] | None = None,
        report: Report = lambda text: None,
        source: Source = tuple,
    ) -> None:
        self.folder = folder
        self.written = 0
        self.lost = 0
        self.failure = ""
        self._options = options
        self._about = about
        self._attachments = attachments or {}
        self._report = report
        self._source = source
        self._waiting: deque[Message] = deque()
        self._held: list[Message] = []
        self._put = self._drained = 0  # bytes
        self._counting = threading.Lock()  # guards `lost` and `_put`, and that nothing is queued after a failure
        self._closed: list[FileSummary] = []
        self._file: RecordingFile | None = None
        self._number = 0
        self._indexed_topics = 0
        self._flush_due_ns = self._index_due_ns = 0
        self._first_offset_ns = to_wall_ns(0)
        self._shift_ns = 0  # of the wall clock since the start
        require_library()
        _make(folder)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def put(self, message: Message) -> None:
        """Queue a message, from any thread, without waiting."""
        size = len(message.data)
        with self._counting:
            room = len(self._waiting) < MAX_WAITING and self._put + size - self._drained <= MAX_WAITING_BYTES
            if room and not self.failure:
                self._put += size
                self._waiting.append(message)
            else:
                self.lost += 1

    def close(self) -> None:
        """Write the queued messages and the index. Closing twice is harmless."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        try:
            if hasattr(os, "sched_setscheduler"):  # Linux; drops the real-time priority of the parent thread
                os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
            while not self._stop.wait(DRAIN_PERIOD_S):
                self._drain(now_ns())
            self._drain(now_ns(), is_last=True)
            self._finish()
        except OSError as error:
            self._fail(f"{error.strerror}; free some space, or record less")
        except Exception as error:  # noqa: BLE001 - a thread would end without a message
            self._fail(f"{type(error).__name__}: {error}; that is a fault of uuv-hil, please report it")

    def _drain(self, now: int, is_last: bool = False) -> None:
        if self._file is None:
            self._begin()
        waiting = [self._waiting.popleft() for _ in range(len(self._waiting))]
        self._drained += sum([len(message.data) for message in waiting])
        messages = sorted([*self._held, *self._by_first_clock([*waiting, *self._source()])], key=_log_time)
        due_ns = to_wall_ns(now) - self._shift_ns - HOLD_NS
        due = len(messages) if is_last else bisect_right(messages, due_ns, key=_log_time)
        self._held = messages[due:]
        self._write(messages[:due])
        if now >= self._flush_due_ns and self._file:
            self._flush_due_ns = now + FLUSH_PERIOD_NS
            self._file.flush()
            # After a crash the index has at least all topics, and what was recorded until some seconds before.
            if self._file.topics > self._indexed_topics or now >= self._index_due_ns:
                self._index_due_ns = now + INDEX_PERIOD_NS
                self._write_index()
            self._check_space()

    def _by_first_clock(self, messages: list[Message]) -> list[Message]:
        """Return the messages with log times by the clock as it was at the start, however it was set since.

        One that came while the clock was set, or that the library stamped by the time before, gets the present time.
        """
        now = now_ns()
        present_ns = self._first_offset_ns + now
        shift_ns = to_wall_ns(now) - present_ns
        if shift_ns != self._shift_ns:
            self._shift_ns = shift_ns
            topic = CLOCK_SHIFT.full_name(self._about.get("node", "recorder"))
            data = encode_int64_array([shift_ns])
            messages.append(Message(topic, CLOCK_SHIFT.type, 0, now + self._first_offset_ns, to_wall_ns(now), data))
        earliest_ns, latest_ns = present_ns - PLAUSIBLE_NS if shift_ns else -NEVER_NS, present_ns + NS_PER_S
        if not shift_ns and all(message.logged_ns < latest_ns for message in messages):
            return messages
        times = [message.logged_ns - shift_ns for message in messages]
        return [
            message._replace(logged_ns=time_ns if earliest_ns < time_ns < latest_ns else present_ns)
            for message, time_ns in zip(messages, times, strict=True)
        ]

    def _write(self, messages: Sequence[Message]) -> None:
        most = _FULL * self._options.file_size * _MIB
        for message in messages:
            assert self._file
            self._file.write(message)
            self.written += 1
            if self._file.size > most:
                self._rotate()

    def _begin(self) -> None:
        name = f"{os.path.basename(self.folder)}_{self._number}.mcap"
        about = self._about | {"file": str(self._number)}
        path = os.path.join(self.folder, name)
        self._file = RecordingFile(path, about, self._attachments, self._options.compression)
        self._number += 1
        self._forget_oldest()
        self._write_index()

    def _rotate(self) -> None:
        if self._file:
            self._closed.append(self._file.close())
        self._begin()

    def _forget_oldest(self) -> None:
        """Delete the oldest files until there is room for a whole file."""
        most = (self._options.total_size - self._options.file_size) * _MIB
        while sum(os.path.getsize(file.path) for file in self._closed) > most:
            os.unlink(self._closed.pop(0).path)

    def _check_space(self) -> None:
        if _free_bytes(self.folder) < self._options.keep_free * _MIB:
            raise OSError(0, f"less than [recording] keep_free = {self._options.keep_free:g} MiB is free")

    def _write_index(self) -> None:
        current = [self._file.summary()] if self._file else []
        self._indexed_topics = self._file.topics if self._file else 0
        write_index(self.folder, [*self._closed, *current])

    def _finish(self) -> None:
        if self._file:
            self._closed.append(self._file.close())
            self._file = None
        self._write_index()

    def _fail(self, why: str) -> None:
        with self._counting:
            self.failure = f"recording into {self.folder} ended: {why}"
            self.lost += len(self._waiting) + len(self._held)
            self._waiting.clear()
        with suppress(Exception):  # the index may not fit on the disk either; the old one lists this file already
            if self._file:
                self._file.abandon()
                self._write_index()
        self._report(self.failure)


def describe(scenario: Scenario, role: str, **more: str) -> tuple[dict[str, str], dict[str, str]]:
    """Return `about` (facts of the run) and `attachments` (the scenario's files, unchanged) for a `Recorder`."""
    import sys

    about = {
        "uuv_hil_version": __version__,
        "python_version": sys.version.split()[0],
        "recorded_by": role,
        "scenario": scenario.path,
        "description": scenario.description,
        "node": scenario.slave.node,
        "seed": str(scenario.seed),
        "boot_id": boot_id(),
        "vehicle": scenario.vehicle,
        "world": scenario.world,
        **more,
    }
    files = {
        "scenario.toml": scenario.path,
        "vehicle.toml": find_preset("sim/vehicles", scenario.vehicle),
        "world.toml": find_preset("sim/worlds", scenario.world),
    }
    return about, {name: _read(path) for name, path in files.items()}


def _make(folder: str) -> None:
    """Make the folder; an existing one is used if it has no recording. Raises ConfigError."""
    try:
        os.makedirs(folder, exist_ok=True)
        if any(name.endswith(".mcap") for name in os.listdir(folder)):
            raise ConfigError(f"{folder}: there is a recording in it already; choose another folder")
        if not os.access(folder, os.W_OK):
            raise ConfigError(f"{folder}: no permission to write there; choose another folder")
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be made: {error.strerror}; choose another folder") from None


def _read(path: str) -> str:
    with open(path, encoding="utf-8") as file:
        return file.read()


def _free_bytes(folder: str) -> int:
    """Return how many bytes this user may still write on the disk of a folder. Raises OSError."""
    if hasattr(os, "statvfs"):
        disk = os.statvfs(folder)
        return disk.f_bavail * disk.f_frsize
    from shutil import disk_usage  # for Windows; imported here, so that a slave does not load its modules

    return disk_usage(folder).free
