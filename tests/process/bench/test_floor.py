"""The latency floor: plain messages to an echo server and back."""

import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hil.bench.floors.network import GIVE_UP, Floor, RoundTrips, wait_ns
from hil.bench.harness import Process, program
from hil.common.clock import NS_PER_S, now_ns


def deadline_in(seconds: float = 60.0) -> int:
    return now_ns() + round(seconds * NS_PER_S)


@contextmanager
def running_echo(folder: Path) -> Iterator[tuple[Process, str, int, int]]:
    with Process([*program(), "bench", "echo"], str(folder / "log")) as echo:
        host, udp, tcp = echo.expect(":", 60.0).split(":")
        yield echo, host, int(udp), int(tcp)


def test_round_trips_to_an_echo_in_another_process_are_measured(tmp_path: Path) -> None:
    with running_echo(tmp_path) as (echo, host, udp, tcp):
        with Floor(host, udp, tcp, 85) as floor:
            for _ in range(10):
                floor.measure(deadline_in())
            assert (len(floor.udp.taken_ns), len(floor.tcp.taken_ns)) == (5, 5)
            assert (floor.udp.lost, floor.tcp.lost) == (0, 0)
            assert 1_000 < min(floor.udp.taken_ns + floor.tcp.taken_ns) < 500_000_000
        assert echo.stop() == 0


def test_the_echo_survives_clients_that_reset_or_do_not_read(tmp_path: Path) -> None:
    with running_echo(tmp_path) as (echo, host, udp, tcp):
        for _ in range(3):
            rude = socket.create_connection((host, tcp))
            rude.sendall(bytes(1000))
            rude.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            rude.close()
        deaf = socket.create_connection((host, tcp))
        deaf.settimeout(0.3)
        with pytest.raises(TimeoutError):
            deaf.sendall(bytes(1 << 26))  # more than the buffers on the way hold
        with Floor(host, udp, tcp, 85) as floor:
            for _ in range(2):
                floor.measure(deadline_in())
            assert len(floor.tcp.taken_ns) == 1
        deaf.close()
        assert echo.stop() == 0, echo.output


def test_measurement_stops_after_a_number_of_unanswered_messages() -> None:
    with socket.socket(type=socket.SOCK_DGRAM) as is_silent, socket.create_server(("127.0.0.1", 0)) as server:
        is_silent.bind(("127.0.0.1", 0))
        with Floor("127.0.0.1", is_silent.getsockname()[1], server.getsockname()[1], 85) as floor:
            for _ in range(20):
                floor.measure(deadline_in(0.02))
            assert (floor.udp.lost, floor.tcp.lost) == (GIVE_UP, GIVE_UP)
            assert floor.udp.is_silent
            assert floor.udp.taken_ns == []


def test_a_late_reply_is_not_taken_for_the_next_one() -> None:
    near_end, far_end = socket.socketpair()
    with near_end, far_end:
        round_trips = RoundTrips(near_end, 16)
        round_trips.measure_once(deadline_in(0.01))
        first = far_end.recv(100)

        def answer_both() -> None:
            second = far_end.recv(100)
            far_end.sendall(first)
            time.sleep(0.05)  # after it was sent, so it takes at least that
            far_end.sendall(second)

        answering = threading.Thread(target=answer_both)
        answering.start()
        round_trips.measure_once(deadline_in())
        answering.join()
        assert round_trips.lost == 1
        assert round_trips.taken_ns[0] * 2 > 0.05 * NS_PER_S


def test_waiting_does_not_end_before_the_deadline() -> None:
    deadline = deadline_in(0.02)
    wait_ns(deadline)
    assert now_ns() >= deadline
