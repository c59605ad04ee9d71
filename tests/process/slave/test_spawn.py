"""A program that a slave starts as its child."""

import os
import signal

import psutil
import pytest

from hil.slave import spawn
from tests.support.processes import free_port


def test_a_program_that_does_not_end_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spawn, "END_WITHIN_S", 0.1)
    before = set(psutil.Process().children())
    end = spawn.start_program("router", "--listen", f"tcp/127.0.0.1:{free_port()}")
    (program,) = set(psutil.Process().children()) - before
    os.kill(program.pid, signal.SIGSTOP)
    end()
    assert not psutil.pid_exists(program.pid)
    end()  # it has gone already


def test_a_program_may_end_before_it_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[int] = []
    monkeypatch.setattr(spawn, "spawn", lambda *_, **__: 4711)
    monkeypatch.setattr(os, "kill", lambda _, number: sent.append(number))
    monkeypatch.setattr(os, "waitpid", lambda pid, _: (pid if len(sent) == 2 else 0, 0))
    monkeypatch.setattr(spawn, "END_WITHIN_S", 0.0)
    spawn.start_program("router")()
    assert sent == [signal.SIGTERM, signal.SIGKILL]
