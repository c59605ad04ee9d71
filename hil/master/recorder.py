"""Write the folder of a run, in files that any tool opens."""

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
    """Make `folder` if it is not there; returns it. Raises ConfigError if it cannot be made, or written to."""
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
    """Write `track.csv`, a row per command, at once. Use as a context.

    If the disk fills up or fails, the track ends with its last whole row, `report` is called, and nothing else does.
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
        """Write one instant: `elapsed` s, true and measured state (NED, FRD), and the command."""
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
        """Close the file without the part of a row that still went into it."""
        if self._file:
            with suppress(OSError):  # what is left of the row does not fit now either
                self._file.close()
            with suppress(OSError):
                os.truncate(self._path, self._size)
            self._file = None
        self._report(f"{self._path} ends here: {error.strerror}; the flight goes on")


class RecordedClient(VehicleClient):
    """A vehicle client that passes all received samples and sent commands to `recorder`, once there is one."""

    recorder: Recorder | None = None

    def send(self, topic: str, payload: bytes) -> int:
        """Send a command as every client does, and note it."""
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
    """Record what `client` receives and commands in `folder`/recording, if the scenario wants it.

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
