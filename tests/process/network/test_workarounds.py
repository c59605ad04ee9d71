"""Faults of the network library that are worked around: a test that fails here says which workaround to remove."""

import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from hil.commands.keys import add_machine, init
from hil.network.opening import listen, open_session
from hil.network.security import Security
from hil.network.settings import Network, settings
from hil.network.sockets import cut, pair_of
from tests.support.processes import free_port, wait_for

CALLBACK = """
import zenoh
session = zenoh.open(zenoh.Config.from_json5('{listen: {endpoints: []}, scouting: {multicast: {enabled: false}}}'))
subscriber = session.declare_subscriber("a", print)
print("open", flush=True)
"""
CONNECTIONS = 10


def test_a_process_with_an_indirect_callback_never_ends() -> None:
    """Remove `hil.network.workarounds.exit_hang` if this fails."""
    with subprocess.Popen([sys.executable, "-c", CALLBACK], stdout=subprocess.PIPE) as process:
        assert process.stdout
        assert process.stdout.readline() == b"open\n"
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(2.0)
        process.kill()


def test_the_library_does_not_reopen_one_of_two_links() -> None:
    """Remove `hil.network.workarounds.half_session` if this fails."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    text = settings("master", (), (endpoint,), Network(), None)
    with listen(endpoint), open_session("connect to", endpoint, text, has_pairs=True) as session:
        assert wait_for(lambda: len(session.links()) == 2)
        cut({pair_of(*session.links()[0][1:])})
        assert wait_for(lambda: len(session.links()) == 1)
        time.sleep(1.0)  # the longest pause between two attempts is 0.05 s
        assert len(session.links()) == 1


def test_the_library_pauses_after_a_failed_handshake(tmp_path: Path) -> None:
    """Remove `hil.network.workarounds.accept_queue` if this fails."""
    keys, port = str(tmp_path / "keys"), free_port()
    init(keys)
    add_machine(keys, "uuv1", ["localhost"])
    security = Security(slave=f"{keys}/uuv1", master="", may_command=("uuv1",))
    with listen(f"tcp/127.0.0.1:{port}", security=security):
        began = time.monotonic()
        connections = [socket.create_connection(("127.0.0.1", port), 30.0) for _ in range(CONNECTIONS)]
        for connection in connections:
            with connection, suppress(ConnectionResetError):
                connection.sendall(b"no handshake" * 10)
                while connection.recv(100):  # the alert
                    pass
        assert time.monotonic() - began > 0.1 * (CONNECTIONS - 2)
