"""Run a program that acts as the STM32 in a separate process: start it, wait for it, stop it."""

import select
import subprocess
from collections.abc import Mapping, Sequence
from typing import IO

from hil.common.children import start_child
from hil.common.errors import DeviceError

START_S = 10.0  # longest time until it is ready
END_S = 5.0  # longest time between SIGTERM and its end; then it is killed


class Child:
    """Process of `command`, ready when this returns; stop it with `close`. Its first line of output reports that.

    command, environment: as for `hil.common.children.start_child`; stdin: its standard input. It ends with this
    process, however that ends. Raises DeviceError with the program's error message if it does not start.
    """

    def __init__(
        self, command: Sequence[str], environment: Mapping[str, str] | None = None, stdin: int | None = None
    ) -> None:
        self._process: subprocess.Popen[str] = start_child(
            command, environment=environment, stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self.pid = self._process.pid
        output = _stream(self._process.stdout)
        if not (select.select([output], (), (), START_S)[0] and output.readline()):
            reason = self._end()[1].strip()
            raise DeviceError(reason or f"{command[0]}: did not start")

    def close(self) -> str:
        """Stop the process, with its outputs neutral; return its final report. Closing twice is harmless."""
        return "" if _stream(self._process.stdout).closed else self._end()[0].strip()

    def _end(self) -> tuple[str, str]:
        """Return the final report of the process and its error messages."""
        self._process.terminate()
        try:
            return self._process.communicate(timeout=END_S)
        except subprocess.TimeoutExpired:  # it is suspended, or hangs
            self._process.kill()
            return self._process.communicate()


def _stream(stream: IO[str] | None) -> IO[str]:
    assert stream is not None
    return stream
