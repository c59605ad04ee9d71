"""The floor: bare messages to an echo and back."""

from pathlib import Path

import pytest

from hil.bench.floor import Floor
from hil.bench.harness import Process, program
from hil.cli import main
from hil.errors import NetworkError
from tests.processes import free_port


def test_an_echo_in_another_process(tmp_path: Path) -> None:
    with Process([*program(), "bench", "echo"], str(tmp_path / "log")) as echo:
        host, udp, tcp = echo.expect(":", 20.0).split(":")
        with Floor(host, int(udp), int(tcp), 85) as floor:
            for _ in range(10):
                floor.measure()
            floor.load(200_000)  # more than a socket's buffer takes at once
        assert (len(floor.udp_ns), len(floor.tcp_ns), floor.lost) == (5, 5, 0)
        assert 1_000 < min(floor.udp_ns + floor.tcp_ns) < 500_000_000
        assert echo.stop() == 0


def test_nobody_there() -> None:
    port = free_port()
    with pytest.raises(NetworkError, match=rf"no echo at 127\.0\.0\.1:{port}: .*uuv-hil bench echo"):
        Floor("127.0.0.1", port, port, 85)


def test_an_address_of_another_machine(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "echo", "--address", "192.0.2.1"]) == 4
    assert "cannot listen on 192.0.2.1" in capsys.readouterr().err
