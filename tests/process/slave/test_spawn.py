"""A program that a slave starts as its child."""

import os
import signal
from unittest import mock

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
    with mock.patch("os.kill", wraps=os.kill) as kill:
        end()
    assert [call.args[1] for call in kill.mock_calls[:2]] == [signal.SIGTERM, signal.SIGKILL]
    assert not psutil.pid_exists(program.pid)
    end()  # it has gone already
