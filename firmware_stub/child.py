"""A program that plays the STM32 in a process of its own: started, waited for, ended."""

import select
import subprocess
from collections.abc import Sequence
from typing import IO

from hil.errors import DeviceError

START_S = 10.0  # the longest until it serves
END_S = 5.0  # the longest from being asked to end until it has; then it is killed


class Child:
    """The process of `command`, serving when this returns, as its first line tells; end it with `close`.

    Raises DeviceError if it does not come up; the message is what it says of that.
    """

    def __init__(self, command: Sequence[str]) -> None:
        self._process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        self.pid = self._process.pid
        said = _stream(self._process.stdout)
        if not (select.select([said], (), (), START_S)[0] and said.readline()):
            reason = self._end()[1].strip()
            raise DeviceError(reason or f"{command[0]}: did not come up")

    def close(self) -> str:
        """End it, its outputs neutral; what it says at the end. Closing twice is harmless."""
        return "" if _stream(self._process.stdout).closed else self._end()[0].strip()

    def _end(self) -> tuple[str, str]:
        """What it says at the end and has said of errors."""
        self._process.terminate()
        try:
            return self._process.communicate(timeout=END_S)
        except subprocess.TimeoutExpired:  # it is stopped, or hangs
            self._process.kill()
            return self._process.communicate()


def _stream(stream: IO[str] | None) -> IO[str]:
    assert stream is not None
    return stream
