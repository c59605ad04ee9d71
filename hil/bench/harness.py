"""What every benchmark stands on: processes of a scenario in a folder of their own, pinned or limited, ended cleanly.

with Bench("paper_field", {"link.protocol": "vesc"}, Limits(cpus=(0,))) as bench:
    slave = bench.start_slave()
    with bench.client() as client:
        ...
"""

import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any, Self

from hil.bench.limits import Confinement, Limits
from hil.bench.scenario_file import write_changed
from hil.clock import NS_PER_S, now_ns
from hil.config import Scenario, load_scenario
from hil.errors import ConfigError, NetworkError
from hil.master.client import VehicleClient
from hil.ports import free_ports
from hil.tables import cache_path

GRACE_S = 10.0  # that a process may take to end
READY_S = 60.0  # that a slave may take to start: a small board, emulated
OF_SLAVE = "slave: "  # before a label of a slave elsewhere
ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))


def program() -> list[str]:
    """The command that is `uuv-hil`: the installed script, as a user starts it, else this checkout."""
    installed = os.path.join(os.path.dirname(sys.executable), "uuv-hil")
    return [installed] if os.path.exists(installed) else [sys.executable, "-m", "hil.cli"]


class Process:
    """A program, what it says in a file. `exec_ns` is when it was executed (monotonic ns)."""

    def __init__(
        self,
        command: list[str],
        log: str,
        confinement: Confinement | None = None,
        environment: dict[str, str] | None = None,
        pass_fds: tuple[int, ...] = (),
    ) -> None:
        self.log = log
        self._memory_mib = confinement.limits.memory_mib if confinement else 0.0
        cpus = confinement.limits.cpus if confinement else ()
        before = os.sched_getaffinity(0)
        with open(log, "w") as file:
            if cpus:
                os.sched_setaffinity(0, cpus)  # which the new process inherits
            try:
                self.exec_ns = now_ns()
                self._process = subprocess.Popen(
                    confinement.command(command) if confinement else command,
                    stdin=subprocess.DEVNULL,
                    stdout=file,
                    stderr=subprocess.STDOUT,
                    env=_environment(self.exec_ns, environment or {}),
                    pass_fds=pass_fds,
                    start_new_session=True,
                )
            finally:
                if cpus:
                    os.sched_setaffinity(0, before)
        self.pid = self._process.pid

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    @property
    def said(self) -> str:
        """All it has said so far."""
        with open(self.log, encoding="utf-8", errors="replace") as file:
            return file.read()

    @property
    def last_words(self) -> str:
        """The last line it said."""
        return (self.said.strip().splitlines() or ["no message"])[-1]

    @property
    def ending(self) -> str:
        """How it ended, and what it said last: to be put behind its name."""
        code = self._process.poll()
        if code is None:
            how = "is still running"
        elif code >= 0:
            how = f"ended with exit code {code}"
        else:
            how = f"was ended by signal {-code} ({signal_name(-code)})"
        if code == -signal.SIGKILL and self._memory_mib:
            how += f", perhaps as it needs more than the {self._memory_mib:.0f} MiB of --memory"
        return f"{how}; it last said: {self.last_words}"

    def expect(self, word: str, seconds: float) -> str:
        """The first line it says with `word` in it. Raises NetworkError when none comes in time, or it ends."""
        deadline = now_ns() + round(seconds * NS_PER_S)
        while True:
            running = self.running  # before what it said is read
            line = next((line for line in self.said.splitlines(keepends=True) if word in line and line[-1] == "\n"), "")
            if line:
                return line.strip()
            if not running:
                raise NetworkError(f"a process did not say {word!r}, but {self.ending}")
            if now_ns() > deadline:
                raise NetworkError(f"a process did not say {word!r} within {seconds:g} s, but: {self.last_words}")
            select.select((), (), (), 0.01)

    def wait(self, seconds: float) -> int:
        """Its exit code. Raises NetworkError when it does not end in time."""
        try:
            return self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            raise NetworkError(f"a process did not end within {seconds:g} s; it last said: {self.last_words}") from None

    def join(self) -> int:
        """Its exit code, at once when it has ended: a wait with a timeout looks now and then, which costs."""
        os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOWAIT)
        return self._process.wait()

    def stop(self) -> int:
        """End it as a user would, by force if that takes too long; its exit code."""
        if self.running:
            self._process.send_signal(signal.SIGTERM)
            self._process.send_signal(signal.SIGCONT)  # one that was stopped would not notice
        try:
            return self._process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()

    def family(self) -> list[int]:
        """Its process id and those of the processes it has started, and they."""
        return list(_family(self.pid))


def _environment(exec_ns: int, more: dict[str, str]) -> dict[str, str]:
    """Ours, and where the modules are if they are not installed."""
    path = os.pathsep.join(filter(None, (ROOT, os.environ.get("PYTHONPATH"))))
    checkout = {"PYTHONPATH": path} if len(program()) > 1 else {}
    return {**os.environ, **checkout, "UUV_HIL_EXEC_NS": str(exec_ns), **more}


def _family(pid: int) -> Iterator[int]:
    yield pid
    try:
        threads = os.listdir(f"/proc/{pid}/task")
        children = [open_text(f"/proc/{pid}/task/{thread}/children") for thread in threads]
    except OSError:  # it has ended
        return
    for child in " ".join(children).split():
        yield from _family(int(child))


def open_text(path: str) -> str:
    """A file of /proc as text; empty when it is gone."""
    try:
        with open(path) as file:
            return file.read()
    except OSError:
        return ""


class Bench:
    """A place for one measurement. Use as a context, which ends all that was started and removes what it wrote.

    scenario: name or path; `changes` to it by dotted key. `limits` bind the slave. `scenario` and `path` are the
    changed one, `processes` what was started. A share of a processor binds no real-time process: under such a limit
    the slave runs without. Raises ConfigError.
    """

    def __init__(self, scenario: str, changes: dict[str, Any] | None = None, limits: Limits = Limits()) -> None:
        self._confinement = Confinement(limits)
        self.processes: list[Process] = []
        self.endpoint = f"tcp/127.0.0.1:{free_ports(1)[0]}"
        self.folder = tempfile.mkdtemp(prefix="uuv-hil-bench-")
        self.path = os.path.join(self.folder, "scenario.toml")
        ours: dict[str, Any] = {"slave.listen": self.endpoint}
        if limits.cpu_share:
            ours["slave.realtime"] = False
        try:
            write_changed(scenario, ours | (changes or {}), self.path)
            self.scenario: Scenario = load_scenario(self.path)
            if self.scenario.member:
                raise ConfigError(
                    f"{scenario}: is of {len(self.scenario.member)} vehicles, and a benchmark is of one: take another "
                    "scenario; `bench load --vehicles 2` measures several on one machine"
                )
        except BaseException:
            self._clear()
            raise

    def __enter__(self) -> Self:
        try:
            self._confinement.__enter__()
        except BaseException:
            self._clear()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for process in reversed(self.processes):
            process.stop()
        self._confinement.__exit__()
        self._clear()

    @property
    def labels(self) -> tuple[str, ...]:
        """What figures of this place have to say of themselves."""
        limits, by = self._confinement.limits, self._confinement.by
        cached = "files in the page cache not counted" if limits.memory_mib else ""
        how = ", ".join(filter(None, (by, cached, "no real-time scheduling" if limits.cpu_share else "")))
        return (f"{limits.label} ({how})" if how else limits.label,) if limits.label else ()

    @property
    def memory_mib(self) -> float:
        """The slave's limit of memory, 0 if it has none."""
        return self._confinement.limits.memory_mib

    def file(self, name: str) -> str:
        """The path of a file in the folder."""
        return os.path.join(self.folder, name)

    def start_slave(self, *options: str, environment: dict[str, str] | None = None) -> Process:
        """The scenario's slave; it is not waited for."""
        command = [*program(), "slave", self.path, *options]
        log = self.file(f"slave-{len(self.processes)}.log")
        return self._start(Process(command, log, self._confinement, environment))

    def start_master(self, *options: str, endpoint: str = "") -> Process:
        """The scenario's master, which flies its mission; comes back when it dials."""
        read_fd, write_fd = os.pipe()
        command = [*program(), "master", self.path, "--connect", endpoint or self.endpoint, *options]
        log = self.file(f"master-{len(self.processes)}.log")
        try:
            process = self._start(Process([*command, "--ready-fd", str(write_fd)], log, pass_fds=(write_fd,)))
        finally:
            os.close(write_fd)
        try:
            if not select.select((read_fd,), (), (), READY_S)[0]:
                raise NetworkError(f"the master did not dial within {READY_S:g} s, but said: {process.last_words}")
            if not os.read(read_fd, 1):
                process.wait(GRACE_S)
                raise NetworkError(f"before it dialled, the master {process.ending}")
        finally:
            os.close(read_fd)
        return process

    def start(self, name: str, command: list[str], limited: bool = False) -> Process:
        """Any other process, ended with the rest; pinned and limited as the slave only if `limited`."""
        log = self.file(f"{name}-{len(self.processes)}.log")
        return self._start(Process(command, log, self._confinement if limited else None))

    def client(self, endpoint: str = "", **options: Any) -> VehicleClient:
        """A master of our own, in this process."""
        scenario = self.scenario
        return VehicleClient(
            endpoint or self.endpoint,
            scenario.slave.node,
            network=scenario.network,
            security=scenario.security,
            **options,
        )

    def _clear(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)
        with suppress(OSError):
            os.remove(cache_path(self.path))

    def _start(self, process: Process) -> Process:
        self.processes.append(process)
        return process


def await_vehicle(client: VehicleClient, slave: Process | None = None, seconds: float = READY_S) -> None:
    """Until its first sample and its figures of health are here. Raises NetworkError."""
    deadline = now_ns() + round(seconds * NS_PER_S)
    while not (client.wait_for_vehicle(0.05) and client.diagnostics() and not client.in_doubt):
        if slave and not slave.running:
            raise NetworkError(f"the slave {slave.ending}")
        if now_ns() > deadline:
            missing = f"no vehicle {client.node!r} answered at {client.endpoint} within {seconds:g} s"
            raise NetworkError(f"{missing}; {f'the slave {slave.ending}' if slave else _why_silent(client)}")
    refusal = client.refusal()
    if refusal:
        raise NetworkError(refusal)


def _why_silent(client: VehicleClient) -> str:
    """What stands in the way of a slave elsewhere, and what to do."""
    from hil.transport.diagnosis import why_not  # only on the way to an error

    fault = why_not(client.endpoint)
    reason = f"somebody answers there, but no {client.node!r} that lets us listen"
    if fault and not fault.lasting:  # what lasts is of certificates, and ours are not asked for here
        reason = fault.text
    return (
        f"{reason}; is `uuv-hil slave` running there, with --listen on an address this machine reaches, and the same "
        "[slave] node?"
    )


def signal_name(number: int) -> str:
    """Such as KILL."""
    try:
        return signal.Signals(number).name.removeprefix("SIG")
    except ValueError:
        return "unknown"


def labels_of(diagnostics: Mapping[str, str]) -> tuple[str, ...]:
    """What figures of a slave elsewhere have to say of themselves, by its own word."""
    return tuple(f"{OF_SLAVE}{label}" for label in diagnostics.get("labels", "").split("; ") if label)
