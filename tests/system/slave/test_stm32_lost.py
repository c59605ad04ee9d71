"""A lost link is reopened in a thread beside the loop, and an emulated STM32 is ended after every failure."""

import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import psutil
import pytest

from firmware_stub import child
from firmware_stub.build import native_compiler
from firmware_stub.child import Child
from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import DeviceError
from hil.links.contract import ThrusterCommand, Wire
from hil.links.wires.net import TcpWire
from hil.scenario.records import Link
from hil.slave.drivers import driver as stm32
from hil.slave.drivers import external as stm32_outside
from hil.slave.drivers import in_process as stm32_inside
from hil.slave.drivers.driver import open_driver, stop_thrusters
from hil.slave.drivers.ends import Ends
from hil.slave.drivers.external import ExternalDriver
from tests.support.links.bench_link import BenchLink
from tests.support.links.link_contract import nothing_leaks
from tests.support.processes import children_of, wait_for

COMMAND = ThrusterCommand(1, True, (1600,) * 6)
AT_ONCE_S = 1.5  # for what takes some microseconds; what waits for the other end waits 2 s at least, or for ever
PROCESSES = [
    "process",
    pytest.param("native", marks=pytest.mark.skipif(not native_compiler(), reason="no C compiler")),
]  # fmt: skip


@pytest.fixture(autouse=True)
def _nothing_left() -> Iterator[None]:
    before = set(children_of(os.getpid()))  # other tests may leave helpers of libraries
    with nothing_leaks():
        yield
    assert set(children_of(os.getpid())) <= before


@pytest.fixture(autouse=True)
def _no_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stm32, "RETRY_S", 0.01)


def seconds_of(task: Callable[[], object]) -> float:
    began = time.monotonic()
    task()
    return time.monotonic() - began


class SlowReopening:
    """A driver that opens its first link at once, and later ones after `may_open` is set; `opened` are all links."""

    def __init__(self) -> None:
        self.opened: list[BenchLink] = []
        self.requested, self.may_open = threading.Event(), threading.Event()
        self.driver = ExternalDriver(self._open, 6, NS_PER_S, lambda _: None, end_s=5.0)

    def lose(self) -> None:
        self.opened[-1].broken = True
        self.driver.service(now_ns())
        assert self.requested.wait(60)

    @property
    def closed(self) -> list[BenchLink]:
        return [link for link in self.opened if link.closed]

    def _open(self) -> Ends:
        if self.opened:
            self.requested.set()
            self.may_open.wait()
        self.opened.append(BenchLink())
        return self.opened[-1].bench_ends()


def test_a_slow_reopening_does_not_delay_the_loop() -> None:
    slow = SlowReopening()
    slow.lose()
    first = slow.opened[0]
    assert slow.closed == [first]
    assert seconds_of(lambda: [slow.driver.service(now_ns()) for _ in range(100)]) < AT_ONCE_S
    assert slow.driver.descriptors == []
    assert now_ns() < slow.driver.deadline_ns, "or the loop would spin"
    slow.may_open.set()
    assert wait_for(lambda: slow.driver.service(now_ns()) or not slow.driver.lost)
    assert slow.driver._ends == slow.opened[-1].bench_ends() != first.bench_ends()
    slow.driver.close()
    assert slow.closed == slow.opened


def test_a_link_that_opens_after_closing_is_closed() -> None:
    slow = SlowReopening()
    slow.lose()
    timer = threading.Timer(0.05, slow.may_open.set)
    timer.start()
    slow.driver.close()
    timer.join()
    assert len(slow.opened) == 2
    assert slow.closed == slow.opened


def test_a_reopened_link_that_was_not_used_yet_is_closed() -> None:
    slow = SlowReopening()
    slow.lose()
    slow.may_open.set()
    assert wait_for(lambda: len(slow.opened) == 2)
    slow.driver.close()
    assert slow.closed == slow.opened


def test_a_machine_that_left_the_network_does_not_delay_the_loop() -> None:
    """The machine has left the network: attempts to connect are neither accepted nor refused."""
    device = TcpWire()
    output: list[str] = []
    driver = open_driver("device", Link(port=device.name), 6, True, 1, output.append)
    device.close()
    deaf = socket.create_server(("127.0.0.1", device.port), backlog=0)
    callers = [socket.socket() for _ in range(4)]
    for caller in callers:
        caller.setblocking(False)
        caller.connect_ex(deaf.getsockname())
    assert wait_for(lambda: driver.service(now_ns()) or output)

    def go_on() -> None:
        for _ in range(20):
            driver.send(COMMAND)
            driver.service(now_ns())
            time.sleep(0.01)

    assert seconds_of(go_on) < 10.0, "20 turns that wait for the other end take 40 s"
    assert not stop_thrusters(driver, 2)
    assert seconds_of(driver.close) < stm32.WIRE_END_S + AT_ONCE_S
    for opened in (deaf, *callers):
        opened.close()
    assert [line.partition(":")[0] for line in output] == [
        "thruster link lost, the STM32's watchdog stops the thrusters"
    ]
    for thread in threading.enumerate():  # which would end with the slave
        if thread.name == "thruster link":
            thread.join(5.0)


@pytest.mark.parametrize("kind", PROCESSES)
def test_a_process_that_cannot_be_reached_is_ended(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stm32_outside, "host_end", refuse_host_end)
    with pytest.raises(DeviceError, match="held by another program"):
        open_driver(kind, Link(), 6, True, 1, print)


@pytest.mark.parametrize("kind", ["python", "unicorn"])
def test_an_stm32_in_this_process_that_cannot_be_reached_is_ended(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stm32_inside, "host_end", refuse_host_end)
    with pytest.raises(DeviceError, match="held by another program"):
        open_driver(kind, Link(), 6, True, 1, print)


def refuse_host_end(wire: Wire, *_: object) -> Any:
    wire.close()  # as `host_end` does
    raise DeviceError("held by another program")


def test_a_wire_without_a_protocol_is_closed() -> None:
    device = TcpWire()
    with pytest.raises(Exception, match="no_such_frame"):
        open_driver("device", Link(port=device.name, frame="no_such_frame"), 6, True, 1, print)
    device.close()


@pytest.mark.parametrize("kind", PROCESSES)
def test_a_stopped_process_is_killed(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child, "END_S", 0.1)
    driver = open_driver(kind, Link(), 6, True, 1, print)
    (pid,) = driver.children
    os.kill(pid, signal.SIGSTOP)
    driver.close()
    assert not psutil.pid_exists(pid)


@pytest.mark.parametrize("kind", PROCESSES)
def test_a_killed_process_is_restarted(kind: str) -> None:
    output: list[str] = []
    driver = open_driver(kind, Link(), 6, True, 1, output.append)
    os.kill(driver.children[0], signal.SIGKILL)

    def is_commanded_again() -> bool:
        driver.send(COMMAND)
        return bool(driver.service(now_ns())) and len(output) == 2

    assert wait_for(is_commanded_again), output
    assert [line[:19] for line in output] == ["thruster link lost,", "thruster link back "]
    driver.close()


def test_a_program_that_never_serves_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child, "START_S", 0.05)
    with pytest.raises(DeviceError, match="sleep: did not start"):
        Child(["sleep", "60"])


def test_an_stm32_process_is_started_with_quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    """An unread pipe is full after half an hour of output, and blocks the process."""

    def start(command: list[str], _environment: dict[str, str]) -> Child:
        raise DeviceError(" ".join(command))

    monkeypatch.setattr(child, "Child", start)
    with pytest.raises(DeviceError, match=" --quiet "):
        open_driver("process", Link(), 6, True, 1, print)
