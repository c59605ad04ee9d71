"""Sessions that publish, and close: their memory, and other threads."""

import subprocess
import sys
import threading

from hil.network.opening import listen
from hil.network.publisher import Publisher
from hil.ros.topics import TOPICS
from tests.support.processes import ROOT, free_port


def test_sessions_that_published_leave_no_memory_behind() -> None:
    """The library never frees a session, 30 kB, that has a declared publisher when it is closed."""
    text = """
from ctypes import CDLL
import psutil
from hil.network.roles import open_master_session
from hil.ros.topics import TOPICS

def private_kib():
    CDLL(None).malloc_trim(0)
    return psutil.Process().memory_full_info().uss / 1024

def grown(again, count):
    before = private_kib()
    for _ in range(count):
        again()
    return (private_kib() - before) / count

def open_and_close():
    with open_master_session("tcp/127.0.0.1:9") as session:
        session.publisher("uuv1", TOPICS["cmd_vel"])
        session.sender("a/key")

grown(open_and_close, 40)
closed = grown(open_and_close, 100)
held = open_master_session("tcp/127.0.0.1:9")
held.publisher("uuv1", TOPICS["cmd_vel"])
print(closed, grown(held.reopen, 100))
"""
    done = subprocess.run([sys.executable, "-c", text], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    closed, reopened = map(float, done.stdout.split())
    assert closed < 10.0
    assert reopened < 10.0


def test_a_session_closes_while_other_threads_publish_and_check_subscribers() -> None:
    """The bindings let no thread undeclare a publisher that another uses at that moment."""
    errors: list[BaseException] = []

    def use(publisher: Publisher, ending: threading.Event) -> None:
        try:
            while not ending.is_set():
                publisher.put(b"x" * 1000, 1)
                publisher.check_subscribers()
        except BaseException as error:  # noqa: BLE001 - whatever it is, the thread would have ended with it
            errors.append(error)

    for _ in range(20):
        ending = threading.Event()
        with listen(f"tcp/127.0.0.1:{free_port()}") as session:
            publisher = session.publisher("uuv1", TOPICS["odom"])
            threads = [threading.Thread(target=use, args=(publisher, ending)) for _ in range(3)]
            for thread in threads:
                thread.start()
        ending.set()
        for thread in threads:
            thread.join()
    assert not errors, errors
