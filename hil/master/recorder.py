"""The folder of a run: what was flown, as files that any tool opens."""

import os
import time
from typing import TextIO

from hil.autonomy.control import VelocityCommand, heading_of
from hil.errors import ConfigError
from sim.sensors.samples import OdometrySample

COLUMNS = (
    "time_s,true_north_m,true_east_m,true_depth_m,north_m,east_m,depth_m,heading_rad,"
    "surge_m_s,commanded_surge_m_s,commanded_yaw_rate_rad_s"
)


def new_folder(name: str, root: str = "runs") -> str:
    """Make and return a folder for a run of the scenario called `name`, by name and time. Raises ConfigError."""
    stem = os.path.splitext(os.path.basename(name))[0]
    folder = os.path.join(root, f"{stem}-{time.strftime('%Y%m%d-%H%M%S')}")
    return make_folder(folder)


def make_folder(folder: str) -> str:
    """Make `folder` if it is not there; returns it. Raises ConfigError if it cannot be made."""
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be made: {error.strerror}; choose another with --run-dir") from None
    return folder


class Recorder:
    """Writes `track.csv`, a row a command. Use as a context."""

    def __init__(self, folder: str) -> None:
        self.folder = folder
        self._file: TextIO = open(os.path.join(folder, "track.csv"), "w")  # noqa: SIM115 - closed by __exit__
        self._file.write(COLUMNS + "\n")

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def row(self, elapsed: float, truth: OdometrySample, odometry: OdometrySample, command: VelocityCommand) -> None:
        """Note one instant: `elapsed` s, true and measured state (NED, FRD), and what was commanded."""
        figures = (
            elapsed,
            *truth.position,
            *odometry.position,
            heading_of(truth.orientation),
            truth.nu[0],
            command.surge,
            command.yaw_rate,
        )
        self._file.write(",".join(f"{figure:.4f}" for figure in figures) + "\n")
