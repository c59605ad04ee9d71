"""Exit of a process with an open session: at its end, by an exception, by sys.exit, by a signal."""

import gc
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import psutil
import pytest

from hil.network.opening import listen
from hil.network.reception import MessageQueue
from hil.network.roles import open_master_session
from hil.ros.topics import TOPICS
from tests.support.processes import PATIENCE_S, ROOT, Program, free_port, wait_for, write_scenario

OPEN = """
import sys, time, threading
from hil.client.client import VehicleClient
from hil.network.presence import declare_presence, serve_last, watch_presence
from hil.network.opening import listen
session = listen("tcp/127.0.0.1:{port}")
session.subscribe("uuv1", "cmd_vel", print, 8)
watch_presence(session, "uuv1", lambda presence, alive: None)
declare_presence(session, "uuv1", "slave")
serve_last(session, "uuv1")
session.receive("uuv_hil/uuv1/ping", lambda payload: None, 8)
client = VehicleClient("tcp/127.0.0.1:{port}", "uuv1")
while not client.contact.present:
    time.sleep(0.01)
print("open", flush=True)
"""


@pytest.mark.parametrize(
    ("ending", "code"),
    [("", 0), ("raise ValueError('x')", 1), ("sys.exit(7)", 7), ("client.close(); session.close()", 0)],
)
def test_a_process_ends_with_an_open_session(ending: str, code: int) -> None:
    text = OPEN.format(port=free_port()) + ending
    done = subprocess.run([sys.executable, "-c", text], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == code, done.stderr
    assert done.stdout == "open\n"


def test_ctrl_c_ends_a_process_with_an_open_session() -> None:
    # A signal that comes just before a sleep does not shorten it: many short ones.
    text = OPEN.format(port=free_port()) + "while True:\n    time.sleep(0.05)\n"
    with subprocess.Popen(
        [sys.executable, "-c", text], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as session:
        assert session.stdout is not None
        assert session.stdout.readline() == b"open\n"
        session.send_signal(signal.SIGINT)
        try:
            session.communicate(timeout=60)
        finally:
            session.kill()
    assert session.returncode == -signal.SIGINT


def test_closing_leaves_no_thread_and_no_descriptor(tmp_path: Path) -> None:
    text = (
        OPEN.format(port=free_port())
        + "import psutil\nbefore = psutil.Process().num_fds()\nclient.close(); session.close()\n"
        + "print(threading.enumerate(), psutil.Process().num_fds() < before)"
    )
    completed = subprocess.run([sys.executable, "-c", text], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert "MainThread" in completed.stdout
    assert completed.stdout.count("<") == 1, completed.stdout
    assert completed.stdout.endswith("True\n")


@pytest.mark.parametrize(("host", "number"), [("127.0.0.1", signal.SIGINT), ("192.0.2.1", signal.SIGTERM)])
def test_the_router_ends_cleanly_also_before_its_address_is_there(tmp_path: Path, host: str, number: int) -> None:
    with Program(tmp_path, "router", "--listen", f"tcp/{host}:{free_port()}") as router:
        router.expect("forwarding")
        began = time.monotonic()
        assert router.stop(number) == 0
        assert time.monotonic() - began < 9.0, "the library waits for 10 s"
    assert "Traceback" not in router.output
    assert wait_for(lambda: not psutil.pid_exists(router.process.pid))


SLAVE_WITH_STUCK_CLOSE = """
import sys, time
from hil.cli import main
from hil.network.session import Session
Session._close_library = lambda _: time.sleep(600)
sys.exit(main(["slave", sys.argv[1]]))
"""


def test_a_slave_ends_although_the_library_does_not_close_its_session(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    command = [sys.executable, "-c", SLAVE_WITH_STUCK_CLOSE, str(scenario)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as slave:
        try:
            assert slave.stdout is not None
            lines = iter(slave.stdout.readline, "")
            assert any("ready" in line for line in lines)
            slave.send_signal(signal.SIGTERM)
            assert any("thrusters neutral" in line for line in lines)
            assert slave.wait(PATIENCE_S) == 0
        finally:
            slave.kill()


def test_messages_after_the_end_of_a_session_are_dropped() -> None:
    with listen(f"tcp/127.0.0.1:{free_port()}") as session:
        send, publisher = session.sender("a/key"), session.publisher("uuv1", TOPICS["odom"])
    send(b"a pong that came late")
    publisher.put(b"a sample that came late", 1)
    assert not publisher.check_subscribers()


def test_a_session_closes_at_once_during_a_callback_of_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    """The close is timed while a peer leaves at the same moment: see `docs/upstream/zenoh_undeclare.md`."""
    put_called = threading.Event()

    def put(_queue: MessageQueue, _status: object) -> None:
        put_called.set()
        time.sleep(0.02)  # in which another thread has the interpreter

    monkeypatch.setattr(MessageQueue, "put", put)
    gc.collect()  # sessions of other tests, which would wait for the same callback

    port = free_port()
    with open_master_session(f"tcp/127.0.0.1:{port}") as other_session:
        slave = listen(f"tcp/127.0.0.1:{port}")
        latched, watched = slave.publisher("uuv1", TOPICS["map"]), slave.publisher("uuv1", TOPICS["odom"])
        slave.watch_subscribers(watched)
        put_called.clear()
        other_session.subscribe("uuv1", "odom", lambda *_: None, 8)
        assert put_called.wait(PATIENCE_S)
        latched.put(b"", 1)
        began = time.monotonic()
        slave.close()
    assert time.monotonic() - began < 9.0, "the library waits for 10 s"
