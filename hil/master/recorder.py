"""Write the folder of a run, in files of common formats."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TextIO

from hil.autonomy.control.controller import VelocityCommand, heading_of
from hil.client.client import VehicleClient
from hil.common.clock import now_ns, to_wall_ns
from hil.common.errors import ConfigError
from hil.recording.mcap_file import Message
from hil.recording.recorder import Recorder, describe
from hil.ros import encoders as ros
from hil.ros.topics import TOPICS
from hil.scenario.config import Scenario
from sim.sensors.samples import OdometrySample

COLUMNS = (
    "time_s,true_north_m,true_east_m,true_depth_m,north_m,east_m,depth_m,heading_rad,"
    "surge_m_s,commanded_surge_m_s,commanded_yaw_rate_rad_s"
)


def make_folder(folder: str) -> str:
    """Create `folder` if it does not exist; return it. Raises ConfigError if it cannot be created or written to."""
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be made: {error.strerror}; choose another folder") from None
    if not os.access(folder, os.W_OK):
        raise ConfigError(f"{folder}: no permission to write there; choose another folder")
    return folder


def complain(text: str) -> None:
    """Print a line on standard error."""
    print(text, file=sys.stderr, flush=True)


class TrackWriter:
    """Write `track.csv`, one row for each command, unbuffered. Use as a context manager.

    If the disk fills up or fails, the track ends with its last complete row and `report` is called; the flight goes on.
    """

    def __init__(self, folder: str, report: Callable[[str], None] = complain) -> None:
        self.folder = folder
        self._path = os.path.join(folder, "track.csv")
        self._report = report
        self._size = 0
        self._file: TextIO | None = None
        try:
            self._file = open(self._path, "w", buffering=1, encoding="utf-8")  # noqa: SIM115 - closed by __exit__
        except OSError as error:
            self._fail(error)
        self._write(COLUMNS)

    def __enter__(self) -> "TrackWriter":
        return self

    def __exit__(self, *_: object) -> None:
        if self._file:
            self._file.close()

    def row(self, elapsed: float, truth: OdometrySample, odometry: OdometrySample, command: VelocityCommand) -> None:
        """Write a row: `elapsed` s, true and measured state (NED, FRD), and the command."""
        figures = (
            elapsed,
            *truth.position,
            *odometry.position,
            heading_of(truth.orientation),
            truth.nu[0],
            command.surge,
            command.yaw_rate,
        )
        self._write(",".join(f"{figure:.4f}" for figure in figures))

    def _write(self, line: str) -> None:
        if self._file is None:
            return
        try:
            self._size += self._file.write(line + "\n")
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        """Close the file and cut off an incomplete row."""
        if self._file:
            with suppress(OSError):  # closing writes the rest of the row, which fails again
                self._file.close()
            with suppress(OSError):
                os.truncate(self._path, self._size)
            self._file = None
        self._report(f"{self._path} ends here: {error.strerror}; the flight goes on")


class RecordedClient(VehicleClient):
    """A vehicle client that passes all received samples and sent commands to `recorder`, if that is set."""

    recorder: Recorder | None = None

    def send(self, topic: str, payload: bytes) -> int:
        """Send a command as every client does, and record it; return its sequence number."""
        sequence = super().send(topic, payload)
        now = to_wall_ns(now_ns())
        self._record_received(topic, payload, sequence, now, now)
        return sequence

    def _deliver(self, topic: str, payload: bytes, attachment: bytes) -> None:
        received_ns = to_wall_ns(now_ns())
        super()._deliver(topic, payload, attachment)
        stamp = ros.unpack_attachment(attachment)
        if stamp and topic in TOPICS:
            self._record_received(topic, payload, stamp.sequence, stamp.time_ns, received_ns)

    def _record_received(self, name: str, payload: bytes, sequence: int, sent_ns: int, received_ns: int) -> None:
        if self.recorder:
            topic = TOPICS[name]
            self.recorder.put(Message(topic.full_name(self.node), topic.type, sequence, sent_ns, received_ns, payload))


@contextmanager
def recorded(client: RecordedClient, scenario: Scenario, folder: str, report: Callable[[str], None]) -> Iterator[None]:
    """Record in `folder`/recording what `client` receives and commands, if the scenario asks for it.

    `report` is called if the recording ends before the flight. Raises ConfigError, MissingExtraError.
    """
    if not scenario.recording.master:
        yield
        return
    board = client.diagnostics().board or ""
    about, files = describe(scenario, "master", board=board)
    with Recorder(os.path.join(folder, "recording"), scenario.recording, about, files, report) as recorder:
        client.recorder = recorder
        try:
            yield
        finally:
            client.recorder = None
