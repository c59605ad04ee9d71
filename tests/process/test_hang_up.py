"""A closed terminal, as after a lost connection to a board, ends the programs in it as Ctrl-C does."""

import os
import pty
import signal
import sys
import time
from pathlib import Path

from hil.common.stop import StopSignals, stop_signals
from tests.support.processes import wait_for, write_scenario


def test_a_slave_ends_cleanly_when_its_terminal_closes(tmp_path: Path) -> None:
    port = tmp_path / "stm32"
    scenario, _ = write_scenario(tmp_path, link=f'port = "pty:{port}"')
    pid, terminal = pty.fork()
    if pid == 0:
        os.execv(sys.executable, [sys.executable, "-m", "hil.cli", "slave", str(scenario)])
    try:
        output = b""
        while b"idle processors" not in output:  # the last line of its start
            output += os.read(terminal, 4096)
        assert port.is_symlink()
    finally:
        os.close(terminal)
    ended: list[int] = []

    def has_ended() -> bool:
        found, status = os.waitpid(pid, os.WNOHANG)
        ended.extend([os.waitstatus_to_exitcode(status)] if found else [])
        return bool(found)

    if not wait_for(has_ended):
        os.kill(pid, signal.SIGKILL)  # none is left running, whatever comes
        os.waitpid(pid, 0)
    assert ended == [0]
    assert not port.is_symlink(), "its port was given back"


def test_an_ignored_hang_up_signal_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        assert signal.SIGHUP not in stop_signals()
        with StopSignals():
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
            os.kill(os.getpid(), signal.SIGHUP)
            time.sleep(0.01)
    finally:
        signal.signal(signal.SIGHUP, before)
    assert signal.SIGHUP in stop_signals()
