"""Common part of benchmarks: start processes of a scenario in a folder, and stop them cleanly.

with Bench("paper_field", {"link.protocol": "vesc"}, ["taskset", "-c", "0"]) as bench:
    slave = bench.start_slave()
    with bench.client() as client:
        ...
"""

import os
import select
import shlex
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from typing import Any

from hil.bench.processes import family
from hil.client.client import VehicleClient
from hil.common.children import module_command, package_environment, start_child
from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import NetworkError
from hil.common.ports import free_ports
from hil.common.scratch import ScratchFolder
from hil.ros.diagnostics import Diagnostics
from hil.scenario.config import Scenario, load_scenario, load_single
from hil.scenario.variant import write_variant

GRACE_S = 10.0  # limit until a process ends
READY_S = 60.0  # limit until a slave starts: on a small emulated board
ONE_VEHICLE = (
    "and a benchmark is of one vehicle: take another scenario; `uuv-hil bench load --vehicles 2` measures several on "
    "one machine"
)
SLAVE_PREFIX = "slave: "  # before a label of a slave elsewhere


def program() -> list[str]:
    """Return the command `uuv-hil`: the installed script, as a user starts it, else this checkout's module."""
    installed = os.path.join(os.path.dirname(sys.executable), "uuv-hil")
    return [installed] if os.path.exists(installed) else module_command("hil.cli")


class Process:
    """Running program that writes its output to a file, or, without `log`, where this process writes its own.

    `exec_ns` is when it was executed (monotonic ns).
    """

    def __init__(
        self,
        command: list[str],
        log: str = "",
        environment: dict[str, str] | None = None,
        pass_fds: tuple[int, ...] = (),
    ) -> None:
        self.log = log
        with open(log, "w", encoding="utf-8") if log else nullcontext() as file:
            self.exec_ns = now_ns()
            self._process = start_child(
                command,
                environment=_environment(self.exec_ns, environment or {}),
                pass_fds=pass_fds,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=file and subprocess.STDOUT,
            )
        self.pid = self._process.pid

    def __enter__(self) -> "Process":
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def running(self) -> bool:
        """True while the process runs."""
        return self._process.poll() is None

    @property
    def output(self) -> str:
        """All output of the process so far."""
        with open(self.log, encoding="utf-8", errors="replace") as file:
            return file.read()

    @property
    def last_line(self) -> str:
        """Last line of the output."""
        return (self.output.strip().splitlines() or ["no message"])[-1]

    @property
    def ending(self) -> str:
        """Return how it ended and its last output, as text that follows its name."""
        code = self._process.poll()
        if code is None:
            how = "is still running"
        elif code >= 0:
            how = f"ended with exit code {code}"
        else:
            how = f"was ended by signal {-code} ({signal_name(-code)})"
        return f"{how}; its last output: {self.last_line}"

    def expect(self, word: str, seconds: float) -> str:
        """Return the first line of output with `word` in it. Raises NetworkError if none comes in time."""
        deadline = now_ns() + round(seconds * NS_PER_S)
        while True:
            running = self.running  # checked before its output is read
            line = next(
                (line for line in self.output.splitlines(keepends=True) if word in line and line[-1] == "\n"), ""
            )
            if line:
                return line.strip()
            if not running:
                raise NetworkError(f"a process did not print {word!r}, but {self.ending}")
            if now_ns() > deadline:
                raise NetworkError(f"a process did not print {word!r} within {seconds:g} s, but: {self.last_line}")
            select.select((), (), (), 0.01)

    def wait(self, seconds: float) -> int:
        """Return its exit code. Raises NetworkError when it does not end in time."""
        try:
            return self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            raise NetworkError(f"a process runs on after {seconds:g} s; its last output: {self.last_line}") from None

    def join(self) -> int:
        """Wait for its end, without a timeout, because a wait with one polls; return its exit code."""
        os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOWAIT)
        return self._process.wait()

    def stop(self) -> int:
        """End it by Ctrl-C, by force if that takes too long; return its exit code."""
        if self.running:
            self._process.send_signal(signal.SIGTERM)
            self._process.send_signal(signal.SIGCONT)  # a suspended process would not receive it
        try:
            return self._process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()

    def family(self) -> list[int]:
        """Return its process id and those of all its descendants."""
        return family(self.pid)


def _environment(exec_ns: int, more: dict[str, str]) -> dict[str, str]:
    """Return this process's environment, with the modules' path if they are not installed."""
    ours = package_environment() if len(program()) > 1 else os.environ
    return {**ours, "UUV_HIL_EXEC_NS": str(exec_ns), **more}


class Bench:
    """Folder and processes of one measurement. Use as a context, which ends the processes and removes the folder.

    scenario: name or path; `changes` to it by dotted key. under: command that runs the slave, such as `taskset -c 0`.
    `scenario` and `path` are the changed one, `processes` those that were started. Raises ConfigError.
    """

    def __init__(self, scenario: str, changes: dict[str, Any] | None = None, under: Sequence[str] = ()) -> None:
        self._under = under
        self.processes: list[Process] = []
        self.endpoint = f"tcp/127.0.0.1:{free_ports(1)[0]}"
        self._scratch = ScratchFolder("bench")
        self.folder = self._scratch.path
        try:
            load_single(scenario, remedy=ONE_VEHICLE)
            self.path = write_variant(scenario, self.folder, {"slave.listen": self.endpoint} | (changes or {}))
            self.scenario: Scenario = load_scenario(self.path)
        except BaseException:
            self._scratch.close()
            raise

    def __enter__(self) -> "Bench":
        return self

    def __exit__(self, *_: object) -> None:
        for process in reversed(self.processes):
            process.stop()
        self._scratch.close()

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the labels of figures that are measured here."""
        return (f"limited: run by {shlex.join(self._under)}",) if self._under else ()

    def file(self, name: str) -> str:
        """Return the path of a file in the folder."""
        return self._scratch.file(name)

    def start_slave(self, *options: str) -> Process:
        """Start the scenario's slave; do not wait for it."""
        command = [*self._under, *program(), "slave", self.path, *options]
        log = self.file(f"slave-{len(self.processes)}.log")
        return self._start(Process(command, log))

    def start_master(self, *options: str, endpoint: str = "") -> Process:
        """Start the scenario's master, which flies its mission; return when it connects."""
        read_fd, write_fd = os.pipe()
        command = [*program(), "master", self.path, "--connect", endpoint or self.endpoint, *options]
        log = self.file(f"master-{len(self.processes)}.log")
        try:
            process = self._start(Process([*command, "--ready-fd", str(write_fd)], log, pass_fds=(write_fd,)))
        finally:
            os.close(write_fd)
        try:
            if not select.select((read_fd,), (), (), READY_S)[0]:
                raise NetworkError(f"the master did not connect within {READY_S:g} s, but printed: {process.last_line}")
            if not os.read(read_fd, 1):
                process.wait(GRACE_S)
                raise NetworkError(f"before it connected, the master {process.ending}")
        finally:
            os.close(read_fd)
        return process

    def start(self, name: str, command: list[str], limited: bool = False) -> Process:
        """Start another process, which ends with the rest; run as the slave only if `limited`."""
        log = self.file(f"{name}-{len(self.processes)}.log")
        return self._start(Process([*self._under, *command] if limited else command, log))

    def client(self, endpoint: str = "", **options: Any) -> VehicleClient:
        """Return a master in this process."""
        scenario = self.scenario
        return VehicleClient(
            endpoint or self.endpoint,
            scenario.slave.node,
            network=scenario.network,
            security=scenario.security,
            **options,
        )

    def _start(self, process: Process) -> Process:
        self.processes.append(process)
        return process


def await_vehicle(client: VehicleClient, slave: Process | None = None, seconds: float = READY_S) -> None:
    """Wait for its first sample and its diagnostics. Raises NetworkError."""
    deadline = now_ns() + round(seconds * NS_PER_S)
    while not (client.wait_for_vehicle(0.05) and client.diagnostics() and not client.in_doubt):
        if slave and not slave.running:
            raise NetworkError(f"the slave {slave.ending}")
        if now_ns() > deadline:
            missing = f"no vehicle {client.node!r} answered at {client.endpoint} within {seconds:g} s"
            raise NetworkError(f"{missing}; {f'the slave {slave.ending}' if slave else _why_silent(client)}")
    client.require_acceptance(client.refusal)  # also for an autopilot or a disarmed vehicle


def _why_silent(client: VehicleClient) -> str:
    """Return why a slave elsewhere cannot be reached, and the remedy."""
    from hil.network.diagnosis import why_not  # only on the way to an error

    fault = why_not(client.endpoint, session=client.session)
    reason = f"somebody answers there, but no {client.node!r} that lets us listen"
    if fault and not fault.lasting:  # lasting faults concern certificates, which are not used here
        reason = fault.text
    return (
        f"{reason}; is `uuv-hil slave` running there, with --listen on an address this machine reaches, and the same "
        "[slave] node?"
    )


def signal_name(number: int) -> str:
    """Return the name of a signal, such as KILL."""
    try:
        return signal.Signals(number).name.removeprefix("SIG")
    except ValueError:
        return "unknown"


def labels_of(diagnostics: Diagnostics) -> tuple[str, ...]:
    """Return the labels of the figures of a slave elsewhere, from its diagnostics."""
    return tuple(f"{SLAVE_PREFIX}{label}" for label in diagnostics.labels or ())
