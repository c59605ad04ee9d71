"""The programs of the project as a user runs them: real processes, real ptys, real sockets."""

import io
import math
import re
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import TypeVar

import psutil

from hil.autonomy.control.controller import VelocityCommand
from hil.cli import main
from hil.client.client import VehicleClient
from hil.common.children import module_command, package_environment, start_child
from hil.common.ports import free_ports

T = TypeVar("T")
ROOT = Path(__file__).parents[2]
END_S = 30.0  # from SIGTERM on, of a program of ours
PATIENCE_S = 60.0  # for what must happen: nothing is said of how soon, as others use the machine too

SCENARIO = """
vehicle = "paper_six"
world = "pool"
{top}
[start]
north = 4
east = 4
depth = 2
[slave]
listen = "tcp/{host}:{port}"
step = {step}
{slave}
[link]
{link}
[master]
goal = [8, 7]
depth = 2
speed = 0.8
time_limit = 40
allow = [{allow}]
"""


def free_port() -> int:
    """Return a port whose neighbour is free too."""
    return free_ports(1)[0]


def write_scenario(
    folder: Path,
    top: str = "",
    slave: str = "",
    link: str = "",
    allow: str = '"link_lost"',
    step: float = 0.01,
    host: str = "127.0.0.1",
    port: int = 0,
) -> tuple[Path, int]:
    """Write a short mission in the pool; return the file and its port (a free one unless given).

    On a busy machine a slave may be delayed for longer than a second, which `allow` permits by default.
    """
    port = port or free_port()
    path = folder / "short.toml"
    path.write_text(SCENARIO.format(top=top, slave=slave, link=link, host=host, port=port, allow=allow, step=step))
    return path, port


def write_blind_mission(folder: Path) -> Path:
    """Write a mission straight ahead into the pool's wall, by the planner `blind.py`, which ignores the map."""
    path, _ = write_scenario(folder)
    (folder / "blind.py").write_text(
        "from hil.autonomy.control.controller import VelocityCommand\n"
        "from hil.master.planner import Done, Planner\n\n\n"
        "class Blind(Planner):\n"
        "    def command(self, time, samples):\n"
        "        return Done('there') if time > 12.0 else VelocityCommand(surge=0.8, heading=0.0, depth=2.0)\n"
    )
    path.write_text(path.read_text() + '[planner]\nclass = "blind:Blind"\n')
    return path


class Program:
    """`uuv-hil ...` in a process, with its output in a file. Use as a context, which ends it.

    command: the command that gets the arguments, instead of that of this checkout. cwd: the folder that it runs in.
    """

    def __init__(
        self,
        folder: Path,
        *arguments: object,
        environment: dict[str, str] | None = None,
        command: list[str] | None = None,
        cwd: Path = ROOT,
    ) -> None:
        self._output = folder / f"output-{time.monotonic_ns()}"
        with self._output.open("w") as file:
            self.process = start_child(
                [*(command or module_command("hil.cli")), *map(str, arguments)],
                stdout=file,
                stderr=subprocess.STDOUT,
                cwd=cwd,
                environment={**package_environment(), "PYTHONUNBUFFERED": "1", **(environment or {})},
            )

    def __enter__(self) -> "Program":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(END_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
                assert kind, f"it did not end within {END_S} s:\n{self.output}"

    @property
    def output(self) -> str:
        """Text that it has printed so far."""
        return self._output.read_text()

    def expect(self, pattern: str, seconds: float = PATIENCE_S) -> re.Match[str]:
        """Wait until the output matches; fails with the whole output if it does not."""
        found = wait_for(lambda: re.search(pattern, self.output), seconds)
        assert found, f"no {pattern!r} in:\n{self.output}"
        return found

    def wait(self, seconds: float = 2.0 * PATIENCE_S) -> int:
        """Return the exit code."""
        return self.process.wait(seconds)

    def stop(self, number: int) -> int:
        """Send a signal and wait; return the exit code."""
        self.process.send_signal(number)
        return self.wait()


def run_here(*arguments: str) -> tuple[int, str]:
    """Run a short `uuv-hil ...` in this process, which is faster; return exit code and output."""
    output = io.StringIO()
    with redirect_stdout(output), redirect_stderr(output):
        try:
            code = main(list(arguments))
        except SystemExit as end:  # of --help, and of a wrong option
            code = int(end.code or 0)
    return code, output.getvalue()


@contextmanager
def running_slave(folder: Path, extra_keys: str = "") -> Iterator[tuple[Program, str]]:
    """Provide a slave of the short mission, with `more` at the end of its scenario, that is ready; and its endpoint."""
    scenario, port = write_scenario(folder)
    scenario.write_text(scenario.read_text() + extra_keys)
    with Program(folder, "slave", scenario) as program:
        program.expect("ready")
        yield program, f"tcp/127.0.0.1:{port}"


@contextmanager
def slave_with(folder: Path, sensors: str) -> Iterator[str]:
    """Provide the endpoint of a slave of the short mission with these lines in [sensors]; it must not fail."""
    with running_slave(folder, f"[sensors]\n{sensors}\n") as (program, endpoint):
        yield endpoint
    assert "Traceback" not in program.output


def command_until(condition: Callable[[], object], *clients: VehicleClient, surge: float = 0.1) -> bool:
    """Send commands from each client, some forty times a second, until the condition is true; return whether it is."""

    def commanded() -> object:
        for client in clients:
            client.command(VelocityCommand(surge=surge))
        return condition()

    return bool(wait_for(commanded))


def surge_of(client: VehicleClient) -> float:
    """Return the true speed ahead of its vehicle in m/s; nan before that is known."""
    stamped = client.latest.get("ground_truth")
    return float(stamped.value.nu[0]) if stamped else math.nan


def wait_for(condition: Callable[[], T | None], seconds: float = PATIENCE_S) -> T | None:
    """Return the first true value of `condition` within the time, else its last."""
    deadline = time.monotonic() + seconds
    while True:
        value = condition()
        if value or time.monotonic() > deadline:
            return value
        time.sleep(0.02)


def children_of(pid: int, recursive: bool = False) -> list[int]:
    """Return the child processes of all threads of a process; with `recursive` all descendants."""
    return [child.pid for child in psutil.Process(pid).children(recursive)]


def is_running(pid: int) -> bool:
    """Return whether the process runs: a zombie, not yet waited for by its parent, does not."""
    with suppress(psutil.NoSuchProcess):
        return psutil.Process(pid).status() not in (psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD)
    return False


def command_line(pid: int) -> str:
    """Return the command line with spaces between its words; empty once the process has ended."""
    with suppress(psutil.Error):
        return " ".join(psutil.Process(pid).cmdline())
    return ""
