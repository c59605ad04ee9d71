"""Start and stop the programs of a case, each in a separate process with its own log."""

import os
import signal
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from hil.bench.harness import GRACE_S, Process, program
from hil.common.errors import NetworkError

if TYPE_CHECKING:
    from typing_extensions import Self


class ProcessGroup:
    """Processes of `uuv-hil`, one for each of `programs` (name and arguments). A context manager, which stops them.

    Their output goes to NAME.log in `folder`. Ctrl-C in the terminal reaches only the process that started them.
    """

    def __init__(self, programs: Mapping[str, Sequence[str]], folder: str) -> None:
        self._programs = programs
        self._folder = folder
        self._running: dict[str, Process] = {}

    def __enter__(self) -> "Self":
        for name, arguments in self._programs.items():
            log = os.path.join(self._folder, f"{name}.log")
            self._running[name] = Process([*program(), *arguments], log, environment={"PYTHONUNBUFFERED": "1"})
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._running.values():  # signal all first, then wait for each
            if process.running:
                os.kill(process.pid, signal.SIGTERM)
        for process in self._running.values():
            with suppress(NetworkError):
                process.wait(GRACE_S)
            process.stop()

    @property
    def pids(self) -> list[int]:
        """Their process ids, in the order of the programs."""
        return [process.pid for process in self._running.values()]

    def check(self) -> None:
        """Raise NetworkError, with its last output, if a process has ended."""
        for name, process in self._running.items():
            if not process.running:
                raise NetworkError(f"{name} ended with exit code {process.wait(0.0)}: {process.last_line}")
