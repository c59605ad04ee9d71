"""Failures of the network between two machines: both detect them, recover, and execute no late command."""

import itertools
import json
import signal
import threading
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from hil.ros.diagnostics import Diagnostics
from tests.support.busy import retry_when_busy
from tests.support.output_lines import Lines
from tests.support.processes import write_scenario
from tools.faults.spaces import Network

pytestmark = pytest.mark.netns

SEEN_WITHIN_S = 1.1
BACK_WITHIN_S = 1.5  # three of the longest pauses between two attempts to connect: the machine may be busy
AGE_LIMIT_MS = 500.0
LOG_S = 0.15  # the slave writes its log ten times a second at most
PORT = 7447


class Outcome(NamedTuple):
    """Seconds from the fault, or from its end, and what the master measured."""

    master_saw: float
    slave_saw: float
    deadman: float
    back: float
    master_back: float
    delays_ms: list[float]
    diagnostics: Diagnostics


class Run:
    """A slave and a master at one switch, perhaps with a router."""

    def __init__(self, network: Network, folder: Path, routed: bool = False) -> None:
        self.network, self.folder = network, folder
        folder.mkdir(parents=True)
        self.output: list[Lines] = []
        self.scenario, _ = write_scenario(folder, allow="", host="0.0.0.0", port=PORT)
        if routed:
            router = f'[network]\nmode = "routed"\nrouter = "tcp/{network.address("router")}:{PORT}"\n'
            self.scenario.write_text(self.scenario.read_text() + router)
        self.endpoint = f"tcp/{network.address('router' if routed else 'slave')}:{PORT}"
        self.ending = folder / "end"
        self.ending.write_text("")
        if routed:
            self.start_router()
        self.start_slave()
        self.master_output = self.listen("master")
        script = "tests/system/netns/commander.py"
        arguments = (script, self.scenario, self.endpoint, self.ending)
        self.master = network.start("master", *arguments, output=self.master_output.file)
        self.master_output.first("commanding", time.monotonic(), 60)
        time.sleep(1.0)

    def listen(self, who: str) -> Lines:
        self.output.append(Lines(self.folder / f"{who}-{len(self.output)}.txt"))
        return self.output[-1]

    def close(self) -> None:
        for reported in self.output:
            reported.close()

    def start_slave(self) -> None:
        self.slave_output = self.listen("slave")
        arguments = ("-m", "hil.cli", "slave", self.scenario)
        self.slave = self.network.start("slave", *arguments, output=self.slave_output.file)

    def start_router(self) -> None:
        arguments = ("-m", "hil.cli", "router", "--scenario", self.scenario, "--listen", f"tcp/0.0.0.0:{PORT}")
        self.router = self.network.start("router", *arguments)

    def apply_fault(self, fault: "Fault") -> Outcome:
        fault.begin(self)
        began = time.monotonic()
        slave_there = fault.slave_sees
        slave_saw = self.slave_output.first("is lost, which commanded", began, 2) if slave_there else 0.0
        deadman = self.slave_output.first("deadman", began, 2) if slave_there else 0.0
        master_saw = self.master_output.first("is lost;", began, 2) if fault.master_sees else 0.0
        time.sleep(max(began + fault.seconds - time.monotonic(), 0))
        ended = time.monotonic()
        fault.end(self)
        if fault.restarts:
            self.slave_output.first("ready", ended, 60)
            ended = time.monotonic()
        after_fault = ended - began
        master_back = (
            self.master_output.first("is back", began, after_fault + 5) - after_fault if fault.master_sees else 0.0
        )
        time.sleep(1.0)
        self.ending.write_text("end")
        self.master.wait(60)
        time.sleep(0.05)
        figures: dict[str, Any] = json.loads(self.master_output.seen[-1][1])
        back = min(at for at in figures["came"] if at > ended) - ended
        return Outcome(
            master_saw, slave_saw, deadman, back, master_back, figures["delays_ms"], Diagnostics(figures["diagnostics"])
        )


class Fault(NamedTuple):
    """A fault: how it begins and ends, for how long, and which side can see it."""

    begin: Callable[[Run], object]
    end: Callable[[Run], object]
    seconds: float
    slave_sees: bool = True
    master_sees: bool = True
    restarts: bool = False
    routed: bool = False


FAULTS = {
    "black hole 3 s": Fault(lambda run: run.network.unplug("slave"), lambda run: run.network.plug("slave"), 3),
    "black hole 2 s": Fault(lambda run: run.network.unplug("slave"), lambda run: run.network.plug("slave"), 2),
    "black hole 7 s": Fault(lambda run: run.network.unplug("slave"), lambda run: run.network.plug("slave"), 7),
    "black hole 12 s": Fault(lambda run: run.network.unplug("slave"), lambda run: run.network.plug("slave"), 12),
    "cable out 3 s": Fault(
        lambda run: run.network.set_cable("slave", False), lambda run: run.network.set_cable("slave", True), 3
    ),
    "slave killed": Fault(lambda run: run.slave.kill(), Run.start_slave, 1, slave_sees=False, restarts=True),
    "slave stopped 3 s": Fault(
        lambda run: run.slave.send_signal(signal.SIGSTOP),
        lambda run: run.slave.send_signal(signal.SIGCONT),
        3,
        slave_sees=False,
    ),
    "master stopped 3 s": Fault(
        lambda run: run.master.send_signal(signal.SIGSTOP),
        lambda run: run.master.send_signal(signal.SIGCONT),
        3,
        master_sees=False,
    ),
    "router killed": Fault(lambda run: run.router.kill(), Run.start_router, 2, routed=True),
    "router unplugged 3 s": Fault(
        lambda run: run.network.unplug("router"), lambda run: run.network.plug("router"), 3, routed=True
    ),
}


def apply_fault(name: str, folder: Path) -> Outcome:
    """Apply one fault in a network of its own; return its outcome."""
    fault = FAULTS[name]
    machines = ("slave", "master", "router") if fault.routed else ("slave", "master")
    with Network(*machines) as network, closing(Run(network, folder / name, fault.routed)) as run:
        return run.apply_fault(fault)


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Outcome | BaseException]:
    """Apply all faults at the same time, each in its own network."""
    folder = tmp_path_factory.mktemp("recovery")
    results: dict[str, Outcome | BaseException] = {}

    def try_fault(name: str) -> None:
        try:
            results[name] = apply_fault(name, folder)
        except BaseException as error:  # noqa: BLE001 - raised by the test it belongs to
            results[name] = error

    threads = [threading.Thread(target=try_fault, args=[name]) for name in FAULTS]
    for thread in threads:
        thread.start()
        time.sleep(0.2)
    for thread in threads:
        thread.join()
    return results


@pytest.mark.parametrize("name", FAULTS)
def test_both_ends_detect_a_network_fault_and_recover(
    outcomes: dict[str, Outcome | BaseException], name: str, tmp_path: Path
) -> None:
    def judge() -> None:
        outcome = found.pop() if found else apply_fault(name, tmp_path / str(next(attempts)))
        if isinstance(outcome, BaseException):
            raise outcome
        check_outcome(name, outcome)

    found, attempts = [outcomes[name]], itertools.count()
    retry_when_busy(judge, "ten at once were too many for the machine: once more, alone", attempts=4)


def check_outcome(name: str, outcome: Outcome) -> None:
    print(name, outcome._replace(delays_ms=[max(outcome.delays_ms)], diagnostics=Diagnostics()))
    assert outcome.master_saw < SEEN_WITHIN_S
    assert outcome.slave_saw < SEEN_WITHIN_S + LOG_S
    assert outcome.deadman < 0.5 + LOG_S + 0.05
    assert outcome.back < BACK_WITHIN_S
    assert outcome.master_back < BACK_WITHIN_S + 0.05
    assert len(outcome.delays_ms) > 50
    # A process that is stopped may have a command in hand: it was taken in time.
    in_hand = 1 if "slave stopped" in name else 0
    assert sorted(outcome.delays_ms)[-1 - in_hand] < AGE_LIMIT_MS, "no command is executed late"
