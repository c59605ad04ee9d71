"""Placeholders for imaging sensors in the loop: each sends a request to the imaging process and does not wait.

When such a sensor is due, the loop sends the vehicle's state to `hil.slave.imaging.process`, which has the world and
the sensors, and publishes the samples itself. While a sensor's last picture is not finished, its further requests are
dropped and counted. The process starts at low priority after the vehicle is ready, and again whenever it has ended. It
ends with the slave, whose pipes then close.
"""

import os
import pickle
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from io import FileIO
from struct import Struct
from typing import TYPE_CHECKING, Any

from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import ConfigError, MissingExtraError
from hil.ros.diagnostics import Diagnostics
from hil.ros.graph import Identity
from hil.scenario.config import Scenario
from hil.slave import usage
from sim.dynamics import State
from sim.sensors.samples import Scene
from sim.sensors.sensor_set import SensorSpec

if TYPE_CHECKING:
    from hil.recording.stamps import Stamps
    from sim.vehicle.accessories import Accessories

# A request: number of the sensor; simulation time, epoch (since 1970) and monotonic time (ns); position, quaternion, nu
# and its rate of change; share of the lights, tilt of the cameras (rad).
REQUEST = Struct("<B3q3d4d6d6d2d")
DONE = Struct("<Bq")  # the answer: number of the sensor; time to make its picture (ns), 0 if nobody subscribes
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 30.0
STEADY_NS = 60 * NS_PER_S  # after a life this long, the pause before the next start is the shortest again
GRACE_S = 2.0
LASTING = (ConfigError.exit_code, MissingExtraError.exit_code)  # a restart would end with the same error
# One thread for array operations: further threads would only take the processor from the loop.
QUIET = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


class Imaging:
    """The offloaded sensors of `scenario`, in their own process from `start` to `close`.

    `self.scenario` is the scenario with placeholders for these sensors. `report` gets a line when the process ends.
    """

    def __init__(self, scenario: Scenario, report: Callable[[str], None]) -> None:
        offloaded = [name for name, fitted in scenario.sensors.items() if fitted.offloaded]
        only = {name: scenario.sensors[name]._replace(instrument=None) for name in offloaded}
        self._true = scenario.for_process(only)
        self._names = offloaded
        self._report = report
        standing_in = {name: self._stand_in(number, name) for number, name in enumerate(offloaded)}
        self.scenario = scenario._replace(sensors={**scenario.sensors, **standing_in})
        self.requested = [0] * len(offloaded)
        self.dropped = [0] * len(offloaded)
        self.took_ns = [0] * len(offloaded)
        self.restarts = 0
        self.pid = 0
        self._busy = [False] * len(offloaded)
        self._stamps: Stamps | None = None
        self._requests: FileIO | None = None
        self._replies: FileIO | None = None
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self, stamps: "Stamps", node: Identity) -> None:
        """Start the process. `stamps` converts the times of pictures; `node` is the node that publishes them."""
        self._stamps = stamps
        setup = pickle.dumps((self._true, node))
        begin = len(setup).to_bytes(4, "little") + setup
        self._thread = threading.Thread(target=self._run, args=(begin,), name="imaging", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the process."""
        self._closing.set()
        self._requests = self._replies = None
        pid, self.pid = self.pid, 0
        if pid:
            _signal(pid, signal.SIGTERM)
        if self._thread:
            self._thread.join(GRACE_S)
            if self._thread.is_alive() and pid:
                _signal(pid, signal.SIGKILL)
                self._thread.join(GRACE_S)

    def request_sample(self, number: int, time_ns: int, state: State, accessories: "Accessories | None") -> None:
        """Request a picture of `state`; called by the loop, never blocks."""
        self.requested[number] += 1
        self._read_answers()
        requests = self._requests
        if requests is None or self._busy[number]:
            self.dropped[number] += 1
            return
        stamps = self._stamps
        assert stamps  # set by `start`, before there is a process
        instants = time_ns, stamps.epoch_ns, stamps.monotonic_ns(time_ns)
        lights_tilt = (accessories.lights(time_ns), accessories.tilt(time_ns)) if accessories else (1.0, 0.0)
        moving = *state.position, *state.quaternion, *state.nu, *state.nu_dot
        request = REQUEST.pack(number, *instants, *moving, *lights_tilt)
        try:
            sent = requests.write(request)
        except OSError:  # the process has ended, which the thread detects too
            sent = None
        self._busy[number] = sent is not None
        self.dropped[number] += sent is None

    @property
    def children(self) -> tuple[int, ...]:
        """Process id of the imaging process, if it runs."""
        return (self.pid,) if self.pid else ()

    def add_figures(self, figures: Diagnostics) -> None:
        """Add the imaging figures to the diagnostics; the process counts as a part of the slave."""
        pid, names = self.pid, self._names
        figures.imaging_pid = pid
        figures.imaging_restarts = self.restarts
        figures.imaging_cpu_s = usage.cpu_s(pid) if pid else 0.0
        figures.imaging_requested = dict(zip(names, self.requested, strict=True))
        figures.imaging_dropped = dict(zip(names, self.dropped, strict=True))
        figures.imaging_took_ms = {name: took_ns / 1e6 for name, took_ns in zip(names, self.took_ns, strict=True)}

    def _stand_in(self, number: int, name: str) -> SensorSpec:
        true = self._true.sensors[name]
        members = {"Model": true.sensor.Model, "topic": true.sensor.topic, "imaging": self, "number": number}
        return true._replace(sensor=type(f"Asking{true.sensor.__name__}", (_Asking,), members))

    def _read_answers(self) -> None:
        pipe = self._replies
        if pipe is None:
            return
        try:
            answers = pipe.read(64 * DONE.size)
        except OSError:
            answers = None
        for number, took_ns in DONE.iter_unpack(answers or b""):  # each is written at once, so none is incomplete
            self._busy[number] = False
            self.took_ns[number] = took_ns or self.took_ns[number]

    def _run(self, begin: bytes) -> None:
        """Run the process, and start it again when it ends, until closed."""
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # inherited by the process
        pause_s = FIRST_PAUSE_S
        while not self._closing.is_set():
            started_ns = now_ns()
            how, code = self._live(begin)
            if self._closing.is_set():
                return
            if code in LASTING:
                self._report(f"no pictures: {how}")
                return
            pause_s = FIRST_PAUSE_S if now_ns() - started_ns > STEADY_NS else pause_s
            self._report(f"WARNING: the imaging process ended, {how}; started again in {pause_s:g} s")
            self._closing.wait(pause_s)
            pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)
            self.restarts += 1

    def _live(self, begin: bytes) -> tuple[str, int]:
        """Run one process from start to end; return how it ended, as text and as exit code."""
        from hil.slave.spawn import spawn_piped  # loaded after the vehicle is ready

        try:  # in a session of its own, so that a Ctrl-C reaches only the slave
            pid, requests, answers, errors = spawn_piped("hil.slave.imaging.process", **QUIET)
        except OSError as error:
            return f"as it cannot be started: {error.strerror}", 1
        self._connect(pid, begin, requests, answers)
        last = _last_line(errors, self._report)
        self._requests = self._replies = None
        self.pid = 0
        code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
        words = f"signal {-code}" if code < 0 else f"exit code {code}"
        return (last if code in LASTING else f"{words}: {last}" if last else words), code

    def _connect(self, pid: int, begin: bytes, request_fd: int, answer_fd: int) -> None:
        """Send the process its setup, then let the loop use it. Each pipe closes when its last user drops it."""
        requests, answers = FileIO(request_fd, "wb"), FileIO(answer_fd, "rb")
        with suppress(OSError):  # the process has ended already
            requests.write(begin)  # fits into the pipe's buffer
        os.set_blocking(request_fd, False)
        os.set_blocking(answer_fd, False)
        self._busy = [False] * len(self._names)
        self._requests, self._replies, self.pid = requests, answers, pid
        if self._closing.is_set():
            self._requests = self._replies = None
            _signal(pid, signal.SIGTERM)


class _Asking:
    """Placeholder for an offloaded sensor in the loop. Each sensor gets a subclass that sets the declared members."""

    offloaded = True
    Model: Any
    topic: str
    imaging: Imaging
    number: int

    def __init__(self, _model: object, _mounting: object, _seed: int, scene: Scene) -> None:
        """Keep the vehicle's accessories only: the imaging process builds the sensor."""
        self._accessories = scene.accessories

    def sample(self, time_ns: int, state: State) -> None:
        """Request a sample; the imaging process publishes it."""
        self.imaging.request_sample(self.number, time_ns, state, self._accessories)


def _last_line(errors_fd: int, report: Callable[[str], None]) -> str:
    """Read the process's standard error until it ends; return its last line. Lines with "note: " go to `report`."""
    last = ""
    with open(errors_fd, errors="replace", encoding="utf-8") as errors:
        for line in errors:
            if line.startswith("note: "):
                report(f"imaging: {line[6:].strip()}")
            elif line.strip():
                last = line.strip()
    return last


def _signal(pid: int, number: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, number)
