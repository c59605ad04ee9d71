"""The output of a process, line by line, with times."""

import threading
import time
from pathlib import Path


class Lines:
    """The output of a process, line by line, with the instants at which it was seen; the process writes to `file`."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.file = path.open("w")
        self.seen: list[tuple[float, str]] = []
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def first(self, text: str, after: float, within: float) -> float:
        """Return seconds from `after` until a line with `text` was seen; fails when there is none within the time."""
        while time.monotonic() < after + within + 1.0:
            found = [at for at, line in self.seen if text in line and at >= after]
            if found:
                return found[0] - after
            time.sleep(0.01)
        raise AssertionError(f"no {text!r} within {within} s in {self.seen}")

    def close(self) -> None:
        """Clean up after the process has ended."""
        self.file.close()
        self._reader.join()

    def _read(self) -> None:
        begun = ""
        with self._path.open() as reader:
            while not self.file.closed:
                *whole, begun = (begun + reader.read()).split("\n")
                self.seen += [(time.monotonic(), line) for line in whole]
                time.sleep(0.005)
