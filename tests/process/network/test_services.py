"""Service calls between two sessions in the format of rmw_zenoh, and their errors."""

import select
import threading
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import psutil
import pytest
import zenoh

from hil.common.errors import NetworkError
from hil.network import services
from hil.network.opening import listen
from hil.network.roles import open_master_session
from hil.network.services import Server, call
from hil.network.session import Session
from hil.ros import encoders as ros
from hil.ros import graph
from hil.ros.cdr import HEADER
from hil.ros.graph import Node
from hil.ros.topics import hash_of
from tests.support.processes import PATIENCE_S, free_port, wait_for

SET_BOOL = "std_srvs/srv/SetBool"


class Serving:
    """A server whose loop runs in a thread; `requested` are the received calls."""

    def __init__(self, session: Session) -> None:
        self.requested: list[Mapping[str, Any]] = []
        self.server = Server(session, Node(session, "uuv1"))
        self.server.offer("/uuv1/arm", SET_BOOL, self._set_value)
        self.server.offer("/uuv1/reset", "std_srvs/srv/Trigger", lambda _: {"success": True, "message": "ähm"})
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _set_value(self, request: Mapping[str, Any]) -> Mapping[str, Any]:
        self.requested.append(request)
        return {"success": request["data"], "message": threading.current_thread().name}

    def _run(self) -> None:
        while not self._stop.is_set():
            if select.select((self.server.fileno(),), (), (), 0.02)[0]:
                self.server.serve()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self.server.close()


@pytest.fixture
def peers() -> Iterator[tuple[Serving, Session]]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with listen(endpoint) as slave, open_master_session(endpoint) as master:
        serving = Serving(slave)
        try:
            assert wait_for(lambda: len(master.tokens(graph.ALL)) == 3)
            yield serving, master
        finally:
            serving.close()


def key_of(name: str) -> str:
    return ros.data_key(0, name, SET_BOOL, hash_of(SET_BOOL))


def test_a_call_is_answered_in_the_servers_own_thread(peers: tuple[Serving, Session]) -> None:
    serving, master = peers
    response = call(master, "/uuv1/arm", SET_BOOL, {"data": True})
    assert response == {"success": True, "message": serving._thread.name}
    assert call(master, "/uuv1/arm", SET_BOOL)["success"] is False
    assert call(master, "/uuv1/reset", "std_srvs/srv/Trigger") == {"success": True, "message": "ähm"}
    assert serving.requested == [{"data": True}, {"data": False}]
    assert serving.server.calls == 3


def test_the_response_repeats_number_and_gid_of_the_request(peers: tuple[Serving, Session]) -> None:
    _, master = peers
    gid = bytes(range(16))
    replies = master._session.get(
        key_of("/uuv1/arm"),
        zenoh.handlers.FifoChannel(2),
        target=zenoh.QueryTarget.ALL_COMPLETE,
        payload=HEADER + b"\1",
        attachment=ros.pack_attachment(77, 5, gid),
    )
    (reply,) = replies
    assert reply.ok is not None
    assert reply.ok.attachment is not None
    stamp = ros.unpack_attachment(reply.ok.attachment.to_bytes())
    assert stamp is not None
    assert (stamp.sequence, stamp.gid) == (77, gid)
    assert abs(stamp.time_ns - time.time_ns()) < 10**10
    assert reply.ok.payload.to_bytes()[:5] == HEADER + b"\1"


@pytest.mark.parametrize(
    ("payload", "attachment"),
    [(b"", ros.pack_attachment(1, 2, bytes(16))), (HEADER, ros.pack_attachment(1, 2, bytes(16))),
     (b"\xff" * 9, ros.pack_attachment(1, 2, bytes(16))), (HEADER + b"\1", b""), (HEADER + b"\1", b"short")],
)  # fmt: skip
def test_a_malformed_request_is_counted_and_not_answered(
    peers: tuple[Serving, Session], payload: bytes, attachment: bytes
) -> None:
    serving, master = peers
    began = time.monotonic()
    assert list(master.query(key_of("/uuv1/arm"), 60.0, payload, attachment)) == []
    assert time.monotonic() - began < 30.0, "the caller learns at once that there is no answer"
    assert serving.server.malformed == 1
    assert serving.requested == []
    assert call(master, "/uuv1/arm", SET_BOOL, {"data": True})["success"] is True


def test_a_repeated_call_is_answered_but_not_executed_again(peers: tuple[Serving, Session]) -> None:
    serving, master = peers
    requests = [ros.pack_attachment(1, 2, bytes(16))] * 2 + [ros.pack_attachment(1, 3, bytes(16))]
    answers = [list(master.query(key_of("/uuv1/arm"), 60.0, HEADER + b"\1", request)) for request in requests]
    assert answers[0] == answers[1]
    assert all(answers)
    assert len(serving.requested) == 2


def test_a_call_waits_until_the_service_appears() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_master_session(endpoint) as master, ThreadPoolExecutor() as pool:
        response = pool.submit(call, master, "/uuv1/arm", SET_BOOL, {"data": True}, 60.0)
        with listen(endpoint) as slave:
            serving = Serving(slave)
            try:
                assert response.result()["success"] is True
            finally:
                serving.close()


@contextmanager
def unattended() -> Iterator[tuple[Server, Session]]:
    """Provide a server that answers only when the test calls `serve`, and a client session."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with listen(endpoint) as slave, open_master_session(endpoint) as master:
        server = Server(slave, Node(slave, "uuv1"))
        server.offer("/uuv1/arm", SET_BOOL, lambda request: {"success": request["data"]})
        assert wait_for(lambda: len(master.tokens(graph.ALL)) == 2)
        yield server, master


def test_calls_beyond_the_queue_are_not_answered() -> None:
    with unattended() as (server, master):
        payload = HEADER + b"\1"
        pending = [
            master._session.get(
                key_of("/uuv1/arm"),
                zenoh.handlers.FifoChannel(2),
                target=zenoh.QueryTarget.ALL_COMPLETE,
                timeout=60.0,
                payload=payload,
                attachment=ros.pack_attachment(number, 2, bytes(16)),
            )
            for number in range(3 * services.WAITING)
        ]
        assert wait_for(lambda: server.dropped == 2 * services.WAITING)
        for _ in range(services.WAITING):
            server.serve()
        assert sum(len(list(replies)) for replies in pending) == server.calls == services.WAITING
        server.close()
        assert list(master.query(key_of("/uuv1/arm"), 0.3, payload, ros.pack_attachment(1, 3, bytes(16)))) == []


def test_each_serve_answers_one_call() -> None:
    """The descriptor stays readable while another call waits."""
    with unattended() as (server, master):
        patient = (master, "/uuv1/arm", SET_BOOL, None, PATIENCE_S)
        threads = [threading.Thread(target=call, args=patient) for _ in range(3)]
        for thread in threads:
            thread.start()
        assert wait_for(lambda: len(server._waiting) == 3)
        for answered in range(3):
            assert server.calls == answered
            assert select.select((server.fileno(),), (), (), 0.0)[0]
            server.serve()
        assert not select.select((server.fileno(),), (), (), 0.0)[0]
        server.serve()
        for thread in threads:
            thread.join()
        assert server.calls == 3
        server.close()


def test_a_large_request_is_refused_undecoded(peers: tuple[Serving, Session], monkeypatch: pytest.MonkeyPatch) -> None:
    serving, master = peers
    payload, attachment = bytes(services.LARGEST + 1), ros.pack_attachment(1, 2, bytes(16))
    reasons: list[str] = []
    assert list(master.query(key_of("/uuv1/arm"), 60.0, payload, attachment, reasons.append)) == []
    assert reasons == ["a request of 8193 bytes is too large; ask for less at once, at most 8192 bytes"]
    assert (serving.server.oversized, serving.server.malformed, serving.requested) == (1, 0, [])
    assert list(master.query(key_of("/uuv1/arm"), 60.0, payload[1:], attachment, reasons.append)) == []
    assert (serving.server.oversized, serving.server.malformed) == (1, 1)
    monkeypatch.setattr(services, "LARGEST", 4)
    with pytest.raises(NetworkError, match=r"/uuv1/arm \(std_srvs/srv/SetBool\) refuses: a request of 5 bytes"):
        call(master, "/uuv1/arm", SET_BOOL, {"data": True})


def test_closing_leaves_no_descriptor_behind() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with listen(endpoint) as slave:
        node = Node(slave, "uuv1")
        before = psutil.Process().num_fds()
        server = Server(slave, node)
        server.close()
        assert psutil.Process().num_fds() == before
