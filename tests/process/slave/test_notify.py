"""Notifications of the slave to systemd: ready, alive while the loop runs, stopping."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.slave.notify import Heartbeat, notify
from tests.support.processes import ROOT, write_scenario


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as wire:
        wire.bind(str(tmp_path / "notify"))
        wire.settimeout(10.0)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        yield wire


def test_a_message_is_sent_to_the_socket(manager: socket.socket) -> None:
    assert notify("READY=1")
    assert manager.recv(100) == b"READY=1"


def test_an_abstract_socket_address_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    name = f"uuv-hil-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as wire:
        wire.bind(f"\0{name}")
        monkeypatch.setenv("NOTIFY_SOCKET", f"@{name}")
        assert notify("STATUS=x@y")
        assert wire.recv(100) == b"STATUS=x@y"


@pytest.mark.parametrize("address", ["", "not-a-path", "/no/such/socket", "@nobody-is-there"])
def test_without_a_socket_nothing_is_sent(monkeypatch: pytest.MonkeyPatch, address: str) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", address)
    assert not notify("READY=1")
    monkeypatch.delenv("NOTIFY_SOCKET")
    assert not notify("READY=1")


def test_a_loop_without_progress_sends_no_watchdog_message(manager: socket.socket) -> None:
    heart = Heartbeat()
    for progress in (0, 400, 400, 400, 800):
        heart.beat(progress)
    manager.setblocking(False)
    assert [manager.recv(100) for _ in range(3)] == [b"WATCHDOG=1"] * 3
    with pytest.raises(BlockingIOError):
        manager.recv(100)


def test_a_slave_sends_its_states_as_a_service(manager: socket.socket, tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    command = [sys.executable, "-m", "hil.cli", "slave", str(scenario)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        try:
            assert [manager.recv(100) for _ in range(3)] == [b"READY=1", b"WATCHDOG=1", b"WATCHDOG=1"]
            process.terminate()
            while (message := manager.recv(100)) == b"WATCHDOG=1":
                pass
            assert message == b"STOPPING=1"
            assert process.wait(60) == 0
        finally:
            process.kill()
