"""Our programs as a user runs them: real processes, real ptys, real sockets."""

import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from hil.ports import free_ports

T = TypeVar("T")
ROOT = Path(__file__).parent.parent

SCENARIO = """
vehicle = "paper_six"
world = "pool"
{top}
[start]
north = 4
east = 4
depth = 2
[slave]
listen = "tcp/127.0.0.1:{port}"
{slave}
[link]
{link}
[master]
goal = [8, 7]
depth = 2
speed = 0.8
time_limit = 40
"""


def free_port() -> int:
    """A port whose neighbour is free too."""
    return free_ports(1)[0]


def write_scenario(folder: Path, top: str = "", slave: str = "", link: str = "") -> tuple[Path, int]:
    """A short mission in the pool; the file and its port."""
    port = free_port()
    path = folder / "short.toml"
    path.write_text(SCENARIO.format(top=top, slave=slave, link=link, port=port))
    return path, port


class Program:
    """`uuv-hil ...` in a process; its output collected in a file. Use as a context, which ends it."""

    def __init__(self, folder: Path, *arguments: object, environment: dict[str, str] | None = None) -> None:
        self._output = folder / f"output-{time.monotonic_ns()}"
        with self._output.open("w") as file:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "hil.cli", *map(str, arguments)],
                stdout=file,
                stderr=subprocess.STDOUT,
                cwd=ROOT,
                env={**os.environ, "PYTHONUNBUFFERED": "1", **(environment or {})},
                start_new_session=True,
            )

    def __enter__(self) -> "Program":
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(10)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()

    @property
    def output(self) -> str:
        """What it has printed so far."""
        return self._output.read_text()

    def expect(self, pattern: str, seconds: float = 15.0) -> re.Match[str]:
        """Wait until the output matches; fails with the whole output if it does not."""
        found = wait_for(lambda: re.search(pattern, self.output), seconds)
        assert found, f"no {pattern!r} in:\n{self.output}"
        return found

    def wait(self, seconds: float = 15.0) -> int:
        """The exit code."""
        return self.process.wait(seconds)

    def stop(self, number: int) -> int:
        """Send a signal and wait; the exit code."""
        self.process.send_signal(number)
        return self.wait()


@contextmanager
def slave_with(folder: Path, sensors: str) -> Iterator[str]:
    """The endpoint of a slave of the short mission with these lines in [sensors]; it must not fail."""
    scenario, port = write_scenario(folder)
    scenario.write_text(f"{scenario.read_text()}[sensors]\n{sensors}\n")
    with Program(folder, "slave", scenario) as program:
        program.expect("ready")
        yield f"tcp/127.0.0.1:{port}"
    assert "Traceback" not in program.output


def wait_for(condition: Callable[[], T | None], seconds: float) -> T | None:
    """The first true value of `condition` within the time, else its last."""
    deadline = time.monotonic() + seconds
    while True:
        value = condition()
        if value or time.monotonic() > deadline:
            return value
        time.sleep(0.02)
