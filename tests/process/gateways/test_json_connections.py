"""Connections of the JSON gateway: their limits in number, time and size, and how they end."""

import socket
import threading
import time
from contextlib import suppress

import pytest

from hil.client.fleet import Fleet
from hil.client.vehicle_handle import Vehicle
from hil.common.errors import NetworkError
from hil.gateways.json_lines.connection import LONGEST_LINE, SOCKET_OPTIONS, Connection
from hil.gateways.json_lines.server import MAX_CONNECTIONS, JsonGateway
from tests.support.clients.json_client import Client, client, fleet, gateway, own_state
from tests.support.processes import wait_for

__all__ = ["client", "fleet", "gateway", "own_state"]  # the fixtures


def test_the_number_of_connections_is_limited(gateway: JsonGateway) -> None:
    clients = [Client(gateway) for _ in range(MAX_CONNECTIONS)]
    try:
        assert clients[-1].call(do="vehicles")["ok"]
        refused = Client(gateway)
        with refused:
            assert "32 connections are open already" in refused.read()["error"]
            assert refused._lines.readline() == b""
        clients.pop().close()
        assert wait_for(lambda: not gateway._connections[-1].is_alive)
        clients.append(Client(gateway))
        assert clients[-1].call(do="vehicles")["ok"], "there is room again"
    finally:
        for client in clients:
            client.close()


def test_idle_connections_take_no_processor_time(gateway: JsonGateway) -> None:
    """The processor time of their threads is measured, which no other load changes."""
    clients = [Client(gateway) for _ in range(10)]
    try:
        assert all(client.call(do="vehicles")["ok"] for client in clients)
        threads = [thread for connection in gateway._connections for thread in connection._threads]
        clocks = [time.pthread_getcpuclockid(thread.ident) for thread in threads if thread.ident]
        assert len(clocks) == 20
        before = sum(map(time.clock_gettime, clocks))
        time.sleep(1.0)
        assert sum(map(time.clock_gettime, clocks)) - before < 0.005
    finally:
        for client in clients:
            client.close()


def test_the_deadman_stops_the_vehicle_of_a_silent_client(gateway: JsonGateway, fleet: Fleet) -> None:
    client = Client(gateway)
    with client:
        assert client.call(do="login", token=gateway.access.token, deadman=0.5)["ok"]
        assert client.call(do="drive", surge=0.3)["ok"]
        (connection,) = gateway._connections
        assert wait_for(lambda: "no line came for 0.5 s" in connection._stopped)
        answer = client.call(do="status")
        assert (answer["over"], answer["error"]) == (True, "stopped: no line came for 0.5 s, the deadman of this login")
        assert wait_for(lambda: abs(fleet["uuv1"].state.velocity[0]) < 0.05)


def test_a_client_that_does_not_read_is_disconnected(gateway: JsonGateway, fleet: Fleet) -> None:
    client = Client(gateway)
    client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    with client:
        assert client.call(do="login", token=gateway.access.token)["ok"]
        assert client.call(do="drive", surge=0.3)["ok"]
        (connection,) = gateway._connections
        with suppress(OSError):  # it hangs up while we still ask
            for _ in range(100_000):
                client.socket.sendall(b'{"do": "get", "sensor": "diagnostics"}\n')
                if not connection.is_alive:
                    break
        assert wait_for(lambda: not connection.is_alive)
        assert wait_for(lambda: abs(fleet["uuv1"].state.velocity[0]) < 0.05)


@pytest.mark.parametrize("size", [LONGEST_LINE, LONGEST_LINE + 1, 3 * LONGEST_LINE - 1, 3 * LONGEST_LINE])
def test_a_line_that_is_too_long_gets_one_error(client: Client, size: int) -> None:
    """A line has `size` bytes and the newline; the next line is understood."""
    answer = client.send(b" " * (size - 2) + b"{}")
    assert (answer["ok"], answer["error"]) == (False, "a line of more than 65536 bytes; send several")
    assert client.call(id=1, do="vehicles")["id"] == 1


def test_a_line_of_the_greatest_length_is_accepted(client: Client) -> None:
    request = b'{"do": "vehicles"}'
    assert client.send(b" " * (LONGEST_LINE - 1 - len(request)) + request)["ok"]


def test_an_unexpected_error_is_answered(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Vehicle, "release", lambda _: 1 / 0)
    answer = client.call(id=3, do="release")
    monkeypatch.undo()
    assert answer == {"id": 3, "ok": False, "error": "ZeroDivisionError: division by zero"}
    assert client.call(do="vehicles")["ok"], "and the connection goes on"


def test_the_vehicle_stops_however_the_connection_ended(
    client: Client, fleet: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A failed send ends the connection; where the vehicle cannot be stopped, nothing more is sent to it."""
    stopped_vehicles: list[Vehicle] = []

    def stop(vehicle: Vehicle) -> None:
        stopped_vehicles.append(vehicle)
        raise NetworkError("gone")

    assert client.call(do="drive")["ok"]
    assert fleet["uuv1"]._action
    monkeypatch.setattr(Vehicle, "stop", stop)
    monkeypatch.setattr(threading, "excepthook", lambda _: None)
    monkeypatch.setattr(Connection, "_send", lambda *_: 1 / 0)
    client.socket.sendall(b"{}\n")
    assert wait_for(lambda: bool(stopped_vehicles) and fleet["uuv1"]._action is None)
    assert stopped_vehicles == [fleet["uuv1"]]


def test_a_connection_has_keep_alive_options(gateway: JsonGateway, client: Client) -> None:
    """The kernel's part is tested here; tests/system/netns disconnects a machine."""
    assert client.call(do="vehicles")["ok"]
    assert wait_for(lambda: bool(gateway._connections))
    (connection,) = gateway._connections
    for level, option, value in SOCKET_OPTIONS:
        assert connection._socket.getsockopt(level, option) == value
    assert connection.is_alive
