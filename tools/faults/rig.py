"""The processes of one row of the campaign: slave, STM32 and planner, and the line between the first two."""

import os
import random
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import psutil

from hil.bench.harness import Process
from hil.common.children import module_command
from hil.common.errors import DeviceError, NetworkError
from hil.common.ports import free_ports
from hil.links.address import open_address
from hil.links.contract import Wire
from hil.links.protocols import open_protocol
from tools.faults.line import Line
from tools.faults.links import DEADMAN_S, WATCHDOG_S, Link
from tools.faults.pins import Pins, State
from tools.faults.relay import Relay
from tools.faults.spaces import Network

THRUSTERS = 6
LOCALHOST = "127.0.0.1"
MACHINES = ("slave", "planner")  # in namespaces of their own, if asked for
HOST = "vehicle.test"
START_S = 60.0
OURS = {"PYTHONPATH": str(Path(__file__).parents[2])}  # tools are never installed
SCENARIO = """
vehicle = "paper_six"
world = "open_water"
stm32 = "device"
{top}
[start]
depth = 5
[slave]
listen = "tcp/{host}:{port}"
deadman = {deadman}
[link]
port = "{near}"
protocol = "{protocol}"
watchdog = {watchdog}
[master]
goal = [8, 7]
depth = 5
{sections}
"""


class Rig:
    """Slave, STM32, line and planners under test, in `folder`. Use as a context; `start` begins.

    `network`: whether the planner reaches the slave through `relay`. `spaces`: whether slave and planner are on
    `machines` of their own, if that is permitted; the planner then finds the slave by the name `HOST`. `environments`:
    further environment variables of the process "slave" or "planner".
    """

    def __init__(
        self, link: Link, folder: Path, network: bool = False, sections: str = "", top: str = "", spaces: bool = False
    ) -> None:
        self.link = link
        self.folder = folder
        self.pins = Pins()
        self.ahead_until_s = 0.0  # when the planner stopped commanding ahead
        self.foreign = 0  # executed commands of planners that must not command
        self.environments: dict[str, dict[str, str]] = {}
        self.has_disk = False  # a small disk, on which the slave records
        self._network = network
        self._stack = ExitStack()
        self.machines = self._open_machines() if spaces else None
        self._words: dict[str, int] = {}  # the descriptors through which planners get their instructions
        self._starts = 0
        self._direction = "silent"  # of the planner
        self.port = free_ports(1)[0]
        self.relay: Relay | None = None
        self.near, self.far = self._addresses()
        near = self.near.removeprefix("pty:")
        self.scenario = folder / "fault.toml"
        self.scenario.write_text(
            SCENARIO.format(
                top=top, host="0.0.0.0" if self.machines else LOCALHOST, port=self.port, deadman=DEADMAN_S, near=near,
                protocol=link.protocol, watchdog=WATCHDOG_S, sections=sections,
            ),
            encoding="utf-8",
        )  # fmt: skip
        self.processes: dict[str, Process] = {}
        self.stm32: Any = None  # a Process, or an emulator with its methods

    def __enter__(self) -> "Rig":
        return self

    def __exit__(self, _: type[BaseException] | None, __: BaseException | None, ___: TracebackType | None) -> None:
        for name in list(self.processes):
            self.end(name)
        self._stack.close()
        self._end_stm32()

    def start(self) -> None:
        """Start all; commands are executed when this returns. Raises NetworkError, DeviceError."""
        self.start_stm32()
        protocol = open_protocol(self.link.protocol, "host", THRUSTERS)
        self.line = self._stack.enter_context(Line(self._open_near, self._open_far, protocol, self.pins))
        if self._network:
            self.relay = self._stack.enter_context(Relay(self.port))
        self.start_slave()
        self.start_planner("planner")

    def start_slave(self, *words: str) -> None:
        """Start the slave with further `words`, or restart it."""
        command = module_command("hil.cli", "slave", str(self.scenario), *words)
        self.start_process("slave", command).expect("ready", START_S)

    def start_planner(self, name: str, patience_s: float = START_S, endpoint: str = "") -> None:
        """Start a planner; it is connected when this returns. Raises NetworkError if not in time."""
        reads, writes = os.pipe()
        host = HOST if self.machines else LOCALHOST
        endpoint = endpoint or (self.relay.endpoint if self.relay else f"tcp/{host}:{self.port}")
        command = [*module_command("tools.faults.planner"), endpoint, str(reads)]
        environment = {
            "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
        }
        self.start_process(name, command, environment, (reads,))
        os.close(reads)
        self._words[name] = writes
        self.processes[name].expect("there", patience_s)

    def at_end(self, task: Callable[[], object]) -> None:
        """Run `task` when all processes have ended."""
        self._stack.callback(task)

    def start_process(
        self, name: str, command: list[str], environment: dict[str, str] | None = None, fds: tuple[int, ...] = ()
    ) -> Process:
        """Return a process of that name, its output in a file of its own."""
        self._starts += 1
        log = str(self.folder / f"{name}-{self._starts}.log")
        if self.machines and name in MACHINES:
            command = [*self.machines.inside(name), *command]
        variables = {"PYTHONUNBUFFERED": "1", **(environment or {}), **self.environments.get(name, {})}
        process = self.processes[name] = Process(command, log, environment=variables, pass_fds=fds)
        return process

    @contextmanager
    def beside(self, name: str, command: list[str], ready: str) -> Iterator[Process]:
        """Run a process beside the others until Ctrl-C; it must end as usual. Raises NetworkError."""
        process = self.start_process(name, command)
        process.expect(ready, START_S)
        yield process
        self.signal(name, signal.SIGINT)
        if self.processes.pop(name).wait(START_S) or "Traceback" in process.output:
            raise NetworkError(f"the {name} {process.ending}")

    def start_stm32(self) -> None:
        """Start the STM32, with neutral outputs."""
        kind, channels = self.link.stm32, str(THRUSTERS)
        if kind == "native":
            from firmware_stub.native import NativeStm32

            self.stm32 = NativeStm32(self.far.removeprefix("pty:"), THRUSTERS, WATCHDOG_S)
            return
        if kind == "unicorn":
            command = [*module_command("tools.faults.emulated"), self.far.removeprefix("pty:")]
        else:
            command = module_command("hil.cli", "stm32", "--port", self.far, "--protocol", self.link.protocol)
            command += ["--channels", channels, "--watchdog", f"{WATCHDOG_S} s"]
        self.stm32 = self.start_process("stm32", command, OURS)
        self.stm32.expect("Ctrl-C", START_S)
        del self.processes["stm32"]

    def signal_stm32(self, number: int) -> None:
        """Send a signal to the STM32's process."""
        os.kill(self.stm32.pid, number)

    def kill_stm32(self) -> None:
        """Kill the STM32 and close its end of the line, as when its supply fails."""
        self.signal_stm32(signal.SIGKILL)
        self.line.lose_far()
        self._end_stm32()

    def revive_stm32(self) -> None:
        """Start the STM32 again, as when its supply is back."""
        self.start_stm32()
        self.line.find_far()

    def instruct(self, word: str, name: str = "planner") -> None:
        """Send a planner a word: ahead, astern, silent, ask."""
        if name == "planner" and word != "ask":
            if word != "ahead" and self._direction == "ahead":
                self.ahead_until_s = time.monotonic()
            self._direction = word
        with suppress(BrokenPipeError):
            os.write(self._words[name], f"{word}\n".encode())

    def signal(self, name: str, number: int) -> None:
        """Send a signal to the process of that name."""
        os.kill(self.processes[name].pid, number)

    def end(self, name: str) -> None:
        """End the process of that name, and close its descriptor."""
        process = self.processes.pop(name, None)
        if process:
            process.stop()
        writes = self._words.pop(name, None)
        if writes is not None:
            os.close(writes)

    def await_pins(self, state: State, seconds: float) -> float:
        """Return when (monotonic s) the outputs reached `state`; nan if not within `seconds`."""
        return self.pins.await_state(state, seconds)

    def pause(self, seconds: float) -> float:
        """Wait; return the instant (monotonic s) after it."""
        time.sleep(seconds)
        return time.monotonic()

    @property
    def descriptors(self) -> int:
        """Number of the slave's open file descriptors; 0 if it does not run."""
        slave = self.processes.get("slave")
        try:
            return psutil.Process(slave.pid).num_fds() if slave and slave.running else 0
        except psutil.Error:
            return 0

    def _open_machines(self) -> Network | None:
        """Make two machines on which `HOST` is the slave; None where that is not permitted."""
        try:
            machines = self._stack.enter_context(Network(*MACHINES))
            machines.silence_name_server("planner")
        except (OSError, subprocess.CalledProcessError):
            return None
        machines.set_file("planner", "hosts", f"{machines.address('slave')} {HOST}\n")
        return machines

    def _end_stm32(self) -> None:
        stm32, self.stm32 = self.stm32, None
        if stm32 is not None:
            with suppress(ProcessLookupError):
                os.kill(stm32.pid, signal.SIGCONT)
            (stm32.stop if isinstance(stm32, Process) else stm32.close)()

    def _addresses(self) -> tuple[str, str]:
        """Return the addresses of the near wire and of the far one."""
        wire = self.link.wire
        if wire == "pty":
            return f"pty:{self.folder / 'near'}", f"pty:{self.folder / 'far'}"
        if wire == "can":
            bus = f"can:mcast:{random.SystemRandom().randrange(1, 255)}"
            return bus, bus
        ports = free_ports(2)
        return f"{wire}://127.0.0.1:{ports[0]}", f"{wire}://127.0.0.1:{ports[1]}"

    def _open_near(self) -> Wire | None:
        """Open the near wire; None on a CAN bus, where a bridge would carry the frames of both buses on each."""
        return None if self.near == self.far else open_address(self.near, "device")

    def _open_far(self) -> Wire:
        """Open the far wire; some exist a little later than the listening process reports."""
        deadline = time.monotonic() + START_S
        while True:
            try:
                return open_address(self.far, "host")
            except DeviceError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.01)
