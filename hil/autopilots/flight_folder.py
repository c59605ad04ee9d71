"""The folder of one vehicle in which its autopilot's program runs: its logs, parameters and missions stay there."""

import os
import shutil

from hil.common.errors import ConfigError, DeviceError
from hil.common.scratch import lock_unused

OUTPUT = "output.txt"  # what the program prints; its presence shows that the folder is one of these
REMEDY = "set [autopilot] folder"


class FlightFolder:
    """A folder that is made if it is missing, and locked until `close`; with `wipe` it is emptied first.

    Raises ConfigError for one with files that no autopilot's program left, or that another process has locked;
    DeviceError if it cannot be made.
    """

    def __init__(self, path: str, *, wipe: bool) -> None:
        self.path = os.path.abspath(path)
        try:
            os.makedirs(self.path, exist_ok=True)
            lock = lock_unused(self.path)
            if lock is None:
                raise ConfigError(f"{self.path}: another run uses this autopilot's folder; {REMEDY}")
            self._lock = lock
            if os.listdir(self.path) and not os.path.exists(self.file(OUTPUT)):
                self.close()
                raise ConfigError(f"{self.path}: not empty, and no autopilot's folder; {REMEDY}")
            if wipe:
                for entry in os.scandir(self.path):
                    shutil.rmtree(entry) if entry.is_dir(follow_symlinks=False) else os.remove(entry)
        except OSError as error:
            raise DeviceError(f"{self.path}: no folder for the autopilot: {error.strerror}; {REMEDY}") from None

    def file(self, name: str) -> str:
        """Return the path of a file in it."""
        return os.path.join(self.path, name)

    def close(self) -> None:
        """Release it."""
        os.close(self._lock)
