"""Sensors that make pictures, as the loop sees them: a word to another process, and no wait.

When such a sensor is due, the loop tells `hil.slave.imaging_process` how the vehicle moves at that instant; that
process has the world and the sensors, and publishes for itself. As long as the last picture of a sensor is not done,
its instants are dropped, and counted. The process is started when the vehicle is ready, at low priority, and again
whenever it ends; it ends with the slave, whose pipes then close.
"""

import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from io import FileIO
from struct import Struct
from typing import Any

from hil import process
from hil.clock import NS_PER_S, now_ns
from hil.config import Link, Scenario
from hil.errors import ConfigError, MissingExtraError
from sim.dynamics import State
from sim.sensors.suite import Fitted

# What the loop asks for: the number of the sensor, the time (ns), position, quaternion, nu and its rate of change.
REQUEST = Struct("<Bq3d4d6d6d")
DONE = Struct("<Bq")  # what comes back: the number of the sensor, how long its picture took (ns; 0: nobody wants it)
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 30.0
STEADY_NS = 60 * NS_PER_S  # a process that lived so long is started again without a long pause
GRACE_S = 2.0
LASTING = (ConfigError.exit_code, MissingExtraError.exit_code)  # with these it would end again
# One thread for arrays: others of the linear algebra would only take the processor from the loop.
QUIET = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


class Imaging:
    """The heavy sensors of `scenario`, in a process of their own from `start` to `close`.

    `scenario` is the same with sensors in their place that only ask. `report` gets a line when the process ends.
    """

    def __init__(self, scenario: Scenario, report: Callable[[str], None]) -> None:
        heavy = [name for name, fitted in scenario.sensors.items() if fitted.heavy]
        only = {name: scenario.sensors[name] for name in heavy}
        self._true = scenario._replace(sensors=only, link=Link(options={}), force=(), failure=(), release=())
        self._names = heavy
        self._report = report
        standing_in = {name: self._stand_in(number, name) for number, name in enumerate(heavy)}
        self.scenario = scenario._replace(sensors={**scenario.sensors, **standing_in})
        self.asked = [0] * len(heavy)
        self.dropped = [0] * len(heavy)
        self.took_ns = [0] * len(heavy)
        self.restarts = 0
        self.pid = 0
        self._busy = [False] * len(heavy)
        self._ask: FileIO | None = None
        self._hear: FileIO | None = None
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self, epoch_ns: int) -> None:
        """Begin, in the thread of the loop; `epoch_ns` is the wall time (ns since 1970) of simulation time 0."""
        _before_the_network()
        told = pickle.dumps((self._true, epoch_ns))
        begin = len(told).to_bytes(4, "little") + told
        self._thread = threading.Thread(target=self._run, args=(begin,), name="imaging", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the process."""
        self._closing.set()
        self._ask = self._hear = None
        pid, self.pid = self.pid, 0
        if pid:
            _signal(pid, signal.SIGTERM)
        if self._thread:
            self._thread.join(GRACE_S)
            if self._thread.is_alive() and pid:
                _signal(pid, signal.SIGKILL)
                self._thread.join(GRACE_S)

    def ask(self, number: int, time_ns: int, state: State) -> None:
        """Ask for a picture of `state`; from the loop, which never waits here."""
        self.asked[number] += 1
        self._take_answers()
        ask = self._ask
        if ask is None or self._busy[number]:
            self.dropped[number] += 1
            return
        request = REQUEST.pack(number, time_ns, *state.position, *state.quaternion, *state.nu, *state.nu_dot)
        try:
            sent = ask.write(request)
        except OSError:  # it has ended, which the thread sees too
            sent = None
        self._busy[number] = sent is not None
        self.dropped[number] += sent is None

    @property
    def children(self) -> tuple[int, ...]:
        """The process, while there is one."""
        return (self.pid,) if self.pid else ()

    def figures(self) -> dict[str, str]:
        """For the diagnostics, in which the process is a part of what the slave costs too."""
        pid = self.pid
        found = {
            "imaging_pid": str(pid),
            "imaging_restarts": str(self.restarts),
            "imaging_cpu_s": f"{process.cpu_s(pid) if pid else 0.0:.2f}",
        }
        for number, name in enumerate(self._names):
            found |= {
                f"{name}_asked": str(self.asked[number]),
                f"{name}_dropped": str(self.dropped[number]),
                f"{name}_took_ms": f"{self.took_ns[number] / 1e6:.1f}",
            }
        return found

    def _stand_in(self, number: int, name: str) -> Fitted:
        true = self._true.sensors[name]
        members = {"Model": true.sensor.Model, "topic": true.sensor.topic, "imaging": self, "number": number}
        return true._replace(sensor=type(f"Asking{true.sensor.__name__}", (_Asking,), members))

    def _take_answers(self) -> None:
        hear = self._hear
        if hear is None:
            return
        try:
            answers = hear.read(64 * DONE.size)
        except OSError:
            answers = None
        for number, took_ns in DONE.iter_unpack(answers or b""):  # each is written at once, so none is cut
            self._busy[number] = False
            self.took_ns[number] = took_ns or self.took_ns[number]

    def _run(self, begin: bytes) -> None:
        """Keep a process alive until closed."""
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # which the process inherits
        pause_s = FIRST_PAUSE_S
        while not self._closing.is_set():
            born_ns = now_ns()
            how, code = self._live(begin)
            if self._closing.is_set():
                return
            if code in LASTING:
                self._report(f"no pictures: {how}")
                return
            pause_s = FIRST_PAUSE_S if now_ns() - born_ns > STEADY_NS else pause_s
            self._report(f"WARNING: the imaging process ended, {how}; started again in {pause_s:g} s")
            self._closing.wait(pause_s)
            pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)
            self.restarts += 1

    def _live(self, begin: bytes) -> tuple[str, int]:
        """One process from its start to its end; how it ended, in words and as its exit code."""
        from hil.slave.spawn import spawn  # the vehicle is ready before this is loaded

        ask, hear, errors = (os.pipe2(os.O_CLOEXEC) for _ in range(3))
        ends = (ask[0], hear[1], errors[1])  # its standard input, output and error
        try:
            # In a group of its own, as a Ctrl-C is the slave's.
            environment = {**os.environ, **QUIET, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
            pid = spawn([sys.executable, "-m", "hil.slave.imaging_process"], environment, ends)
        except OSError as error:
            for end in (ask[1], hear[0], errors[0]):
                os.close(end)
            return f"as it cannot be started: {error.strerror}", 1
        finally:
            for end in ends:
                os.close(end)
        self._connect(pid, begin, ask[1], hear[0])
        last = _last_line(errors[0], self._report)
        self._ask = self._hear = None
        self.pid = 0
        code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
        words = f"signal {-code}" if code < 0 else f"exit code {code}"
        return (last if code in LASTING else f"{words}: {last}" if last else words), code

    def _connect(self, pid: int, begin: bytes, ask_fd: int, hear_fd: int) -> None:
        """Let the loop ask this process, once it knows its part. The pipes close when nobody uses them any more."""
        ask, hear = FileIO(ask_fd, "wb"), FileIO(hear_fd, "rb")
        with suppress(OSError):  # it has ended already
            ask.write(begin)  # less than a pipe holds
        os.set_blocking(ask_fd, False)
        os.set_blocking(hear_fd, False)
        self._busy = [False] * len(self._names)
        self._ask, self._hear, self.pid = ask, hear, pid
        if self._closing.is_set():
            self._ask = self._hear = None
            _signal(pid, signal.SIGTERM)


class _Asking:
    """Stands in the loop for a heavy sensor; each has a class of its own, with the members that are only declared."""

    heavy = True
    Model: Any
    topic: str
    imaging: Imaging
    number: int

    def __init__(self, *_: object) -> None:
        """Nothing to prepare."""

    def sample(self, time_ns: int, state: State) -> None:
        """Ask; what comes of it goes out elsewhere."""
        self.imaging.ask(self.number, time_ns, state)


def _before_the_network() -> None:
    """Let a real-time loop go before the threads of its session, which pass the pictures on and were as urgent."""
    if os.sched_getscheduler(0) == os.SCHED_FIFO:
        with suppress(PermissionError):  # no higher priority is allowed
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(os.sched_getparam(0).sched_priority + 1))


def _last_line(errors_fd: int, report: Callable[[str], None]) -> str:
    """Read what it has to say until it ends; the last of it. Notes are passed on."""
    last = ""
    with open(errors_fd, errors="replace") as errors:
        for line in errors:
            if line.startswith("note: "):
                report(f"imaging: {line[6:].strip()}")
            elif line.strip():
                last = line.strip()
    return last


def _signal(pid: int, number: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, number)
