"""Requests to the imaging process, and the pauses between its lives, without that process."""

import ctypes
import os
from pathlib import Path
from signal import SIGKILL, SIGTERM
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import MagicMock, call

import pytest

from hil.ros.diagnostics import Diagnostics
from hil.scenario.config import load_scenario
from hil.slave.imaging import process
from hil.slave.imaging import sensors as module
from hil.slave.imaging.sensors import DONE, GRACE_S, LASTING, REQUEST, STEADY_NS, Imaging
from tests.support.clients.imaging_slave import SENSORS
from tests.support.processes import write_scenario

STATE: Any = SimpleNamespace(position=(1.0,) * 3, quaternion=(2.0,) * 4, nu=(3.0,) * 6, nu_dot=(4.0,) * 6)
MOVING = (*STATE.position, *STATE.quaternion, *STATE.nu, *STATE.nu_dot)
LIT: Any = SimpleNamespace(lights=lambda _: 0.5, tilt=lambda _: 0.25)
ANSWERED, IDLE = DONE.pack(0, 3_000_000), DONE.pack(0, 0)


def test_a_sensor_has_one_request_at_a_time(tmp_path: Path) -> None:
    imaging = Imaging(load_scenario(str(write_scenario(tmp_path, top=SENSORS)[0])), print)
    written, figures = list[bytes](), Diagnostics()
    pipe: Any = SimpleNamespace(write=lambda request: written.__iadd__([request]), read=lambda _: b"")
    stamps: Any = SimpleNamespace(epoch_ns=7, monotonic_ns=lambda time_ns: time_ns + 1)

    def request(number: int, answer: bytes = b"", accessories: Any = None) -> tuple[int, int]:
        pipe.read = lambda _: answer
        imaging.request_sample(number, 100, STATE, accessories)
        return len(written), imaging.dropped[number]

    assert request(0) == (0, 1), "there is no process yet"
    imaging._stamps, imaging._requests, imaging._replies = stamps, pipe, pipe
    assert (request(0), request(0), request(1, accessories=LIT)) == ((1, 1), (1, 2), (2, 0))
    sent = [(0, 100, 7, 101, *MOVING, 1.0, 0.0), (1, 100, 7, 101, *MOVING, 0.5, 0.25)]
    assert [REQUEST.unpack(each) for each in written] == sent
    assert (request(0, ANSWERED), request(0, IDLE + DONE.pack(1, 4_000_000)), request(0)) == ((3, 2), (4, 2), (4, 3))
    accepts, pipe.write = pipe.write, lambda _: None
    assert request(0, IDLE) == (4, 4), "the pipe is full"
    pipe.write = lambda _: os.write(-1, b"")
    assert request(0) == (4, 5), "the process has ended"
    pipe.write = accepts
    assert request(0) == (5, 5), "neither is waited for"
    imaging.add_figures(figures)
    found = figures.imaging_requested, figures.imaging_dropped, figures.imaging_took_ms
    assert [list((each or {}).values()) for each in found] == [[9.0, 1.0], [5.0, 0.0], [3.0, 4.0]]


def test_a_process_is_started_again_after_longer_pauses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now, lines, pauses = [0], list[str](), list[float]()
    imaging = Imaging(load_scenario(str(write_scenario(tmp_path)[0])), lines.append)
    lives = iter([*[(1, 1)] * 3, (STEADY_NS, 1), (STEADY_NS + 1, 1), *[(1, 1)] * 3, (1, LASTING[0]), (1, 1)])

    def live(_: bytes) -> tuple[str, int]:
        lasted_ns, code = next(lives)
        now[0] += lasted_ns
        return f"exit code {code}", code

    monkeypatch.setattr(module, "now_ns", lambda: now[0])
    monkeypatch.setattr(os, "sched_setscheduler", lambda *_: None)
    monkeypatch.setattr(module, "LONGEST_PAUSE_S", 3.0)
    monkeypatch.setattr(imaging, "_live", live)
    monkeypatch.setattr(imaging._closing, "wait", pauses.append)
    imaging._run(b"")
    assert pauses == [0.5, 1.0, 2.0, 3.0, 0.5, 1.0, 2.0, 3.0]
    assert (imaging.restarts, len(lines), lines[-1]) == (8, 9, f"no pictures: exit code {LASTING[0]}")


@pytest.mark.filterwarnings("ignore::ResourceWarning")  # a pipe closes when its last user drops it
def test_a_process_gets_its_setup_and_its_end_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told, signals, waits = list[Any](), list[Any](), list[float]()

    def report(line: str) -> None:
        ends = [each and os.get_blocking(each.fileno()) for each in (imaging._requests, imaging._replies)]
        told.append((line, imaging.children, imaging._busy, ends))

    def live(status: int) -> tuple[str, int]:
        (setup, to_it), (answers, from_it), (errors, its_errors) = (os.pipe() for _ in range(3))
        monkeypatch.setattr("hil.slave.spawn.spawn_piped", lambda *_, **__: (77, to_it, answers, errors))
        monkeypatch.setattr(os, "waitpid", lambda *_: (77, status))
        os.write(its_errors, b"note: hello\nlast words\n\n")
        os.close(its_errors)
        imaging._busy = [True] * 2
        end = imaging._live(b"setup")
        assert os.read(setup, 9) + os.read(setup, 9) == b"setup", "the pipe is closed after it"
        for descriptor in (setup, from_it):
            os.close(descriptor)
        return end

    imaging = Imaging(load_scenario(str(write_scenario(tmp_path, top=SENSORS)[0])), report)
    monkeypatch.setattr(os, "kill", lambda *signal: signals.append(signal))
    assert live(9) == ("signal 9: last words", -9)
    assert live(1 << 8) == ("exit code 1: last words", 1)
    assert live(LASTING[0] << 8) == ("last words", LASTING[0])
    assert (told, imaging.children) == ([("imaging: hello", (77,), [False, False], [False, False])] * 3, ())
    imaging.pid, imaging._thread = 77, cast(Any, SimpleNamespace(join=waits.append, is_alive=lambda: True))
    imaging.close()
    assert (signals, waits, imaging.pid) == ([(77, SIGTERM), (77, SIGKILL)], [GRACE_S] * 2, 0)
    assert live(0) == ("exit code 0: last words", 0)
    assert (signals[2:], told[3][3]) == ([(77, SIGTERM)], [None, None]), "it has started meanwhile"


def test_the_imaging_process_gives_way_to_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    libc, others = MagicMock(), MagicMock()
    libc.syscall.side_effect = 0, -1  # the second time, this kernel does not know the call
    monkeypatch.setattr(ctypes, "CDLL", lambda _: libc)
    monkeypatch.setattr(os, "uname", lambda: SimpleNamespace(machine="aarch64"))
    for name in ("sched_setaffinity", "sched_setscheduler", "nice"):
        monkeypatch.setattr(os, name, getattr(others, name))
    for processors in ({2, 5, 7}, {2}):
        monkeypatch.setattr(os, "sched_getaffinity", lambda _, found=processors: found)
        process._lower_priority()
    attributes = process.SCHED_ATTR.pack(48, os.SCHED_BATCH, 0, process.NICE, 0, process.SHARE_NS, 0, 0)
    assert libc.syscall.call_args_list == [call(274, 0, attributes, 0)] * 2
    by_others = call.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0)), call.nice(process.NICE)
    assert others.mock_calls == [call.sched_setaffinity(0, [5, 7]), *by_others, call.sched_setaffinity(0, [2])]
