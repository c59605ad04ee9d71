"""Free ports: a port that was given to one process is not given to another, although nothing listens there yet."""

import socket
import subprocess
import sys
from contextlib import suppress

import pytest

from hil.common import ports

REQUEST_PORTS = "from hil.common.ports import free_ports; print(*free_ports(3), flush=True); input()"


def test_simultaneous_processes_get_different_ports() -> None:
    children = [
        subprocess.Popen(
            [sys.executable, "-c", REQUEST_PORTS], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        for _ in range(3)
    ]
    port_numbers = ports.free_ports(3)
    for child in children:
        assert child.stdout is not None
        port_numbers += map(int, child.stdout.readline().split())
    for child in children:
        child.communicate("\n")
    assert len({port // ports._BLOCK for port in port_numbers}) == 4, "of four blocks"
    assert len(set(port_numbers)) == 12


def test_a_process_gets_a_hundred_different_ports() -> None:
    assert len({ports.free_ports(1)[0] for _ in range(100)}) == 100


def test_a_port_that_is_in_use_or_whose_neighbour_is_in_use_is_skipped(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, third = ports.free_ports(3)
    monkeypatch.setattr(ports, "_own_block", lambda pid: (3, iter((first, second, third))))
    with socket.create_server(("127.0.0.1", first)), socket.create_server(("127.0.0.1", second + 1)):
        assert ports.free_ports(3) == [third]


def test_any_port_is_given_when_all_blocks_are_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ports, "_END", ports._FIRST + ports._BLOCK)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as other:
        with suppress(OSError):  # another process of this machine has it
            other.bind(f"\0uuv-hil-ports-{ports._FIRST}")
        many, given = ports._own_block.__wrapped__(0)
        assert many == ports._BLOCK // 2
        assert next(given) in range(ports._FIRST, ports._FIRST + ports._BLOCK, 2)
