"""`uuv-hil demo`: it commands only the slave that it started."""

import os
import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from hil.commands.demo import require_free
from hil.common.errors import NetworkError
from tests.support.processes import Program, children_of, command_line, free_port, wait_for, write_scenario


@contextmanager
def occupied_port(address: str, port: int, family: socket.AddressFamily = socket.AF_INET) -> Iterator[None]:
    with socket.create_server((address, port), family=family):
        yield


@pytest.mark.parametrize("address", ["127.0.0.1", "0.0.0.0"])
@pytest.mark.parametrize("next_one", [0, 1])
@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0", "localhost"])
def test_a_port_in_use_is_refused(address: str, next_one: int, host: str, monkeypatch: pytest.MonkeyPatch) -> None:
    port, resolve = free_port(), socket.getaddrinfo

    def both(_: str, number: int, **kind: Any) -> list[Any]:
        """As on many machines, also on some that have no IPv6."""
        return [*resolve("::1", number, **kind), *resolve("127.0.0.1", number, **kind)]

    if host == "localhost":
        monkeypatch.setattr(socket, "getaddrinfo", both)
    endpoint = f"tcp/{host}:{port}"
    require_free(endpoint)
    words = rf"{endpoint} is not free .*\(port {port + next_one}: Address already in use\).*--listen tcp/127.0.0.1:\d+"
    with occupied_port(address, port + next_one), pytest.raises(NetworkError, match=words):
        require_free(endpoint)
    require_free(endpoint)


def test_closed_connections_of_the_last_demo_do_not_occupy_the_port() -> None:
    port = free_port()
    with socket.create_server(("127.0.0.1", port)) as server, socket.create_connection(("127.0.0.1", port)) as client:
        accepted, _ = server.accept()
        accepted.close()  # who closes first keeps the port for a minute: TIME_WAIT
        assert client.recv(1) == b""
    require_free(f"tcp/127.0.0.1:{port}")


def test_no_table_is_printed_when_the_slave_fails(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    folder = tmp_path / "run"
    with Program(tmp_path, "demo", scenario, "--output", folder) as demo:
        demo.expect("flying")
        assert wait_for(lambda: (folder / "track.csv").read_text().count("\n") > 1), "rows are there at once"
        os.kill(slave_of(demo), signal.SIGKILL)
        assert demo.wait() == 4, demo.output
    assert "the slave was ended by signal 9" in demo.output
    assert "master CPU" not in demo.output


def slave_of(demo: Program) -> int:
    (slave,) = (child for child in children_of(demo.process.pid) if " slave " in command_line(child))
    return slave
