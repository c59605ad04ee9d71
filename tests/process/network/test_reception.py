"""Reader threads and their queues: in order, bounded, the newest kept, and asleep while there is nothing."""

import threading
import time

import psutil
import pytest

from hil.common.clock import NS_PER_S
from hil.network.opening import listen
from hil.network.reception import ReaderThread
from hil.network.roles import open_master_session
from tests.support.processes import free_port, wait_for


def test_items_are_processed_in_order_and_lost_beyond_the_queue_size() -> None:
    worker, few_items, all_items = ReaderThread(), list[int](), list[int]()
    some, put_all = worker.open_queue(few_items.append, 3).put, worker.open_queue(all_items.append).put
    for number in range(5):
        some(number)
    for number in range(5):
        put_all(number)
    worker.end()
    worker.run()
    assert (few_items, all_items) == ([2, 3, 4], [0, 1, 2, 3, 4])


def test_items_beyond_the_rate_are_lost_until_the_second_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    now = NS_PER_S
    monkeypatch.setattr("hil.network.reception.now_ns", lambda: now)
    worker, used = ReaderThread(), list[int]()
    queue = worker.open_queue(used.append, 6, 2)
    for number in range(12):
        now += NS_PER_S // 4
        queue.put(number)
    worker.end()
    worker.run()
    assert used == [0, 1, 4, 5, 8, 9]
    assert queue.lost == 6
    now += NS_PER_S
    full = worker.open_queue(used.append, 0, 2)
    full.put(12)
    assert full.lost == 1, "what finds no room is counted too"


def test_an_exception_loses_one_item_and_is_reported_once(monkeypatch: pytest.MonkeyPatch) -> None:
    worker, used, reported = ReaderThread(), list[float](), list[threading.ExceptHookArgs]()
    monkeypatch.setattr(threading, "excepthook", reported.append)
    divide = worker.open_queue(lambda number: used.append(1 / number)).put
    for number in (1, 0, 2, 0, 4):
        divide(number)
    worker.end()
    worker.run()
    assert used == [1.0, 0.5, 0.25]
    assert worker.failures == 2
    assert [args.exc_type for args in reported] == [ZeroDivisionError]


def wakeups(name: str) -> int:
    """Return how often a thread of this process has slept."""
    thread = next(thread for thread in threading.enumerate() if thread.name == name)
    return psutil.Process(thread.native_id).num_ctx_switches().voluntary


def test_pings_and_presence_share_a_thread_that_sleeps_when_idle() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    pings, events, threads = list[bytes](), list[tuple[str, bool]](), set[str]()

    def ping(payload: bytes) -> None:
        pings.append(payload)
        threads.add(threading.current_thread().name)

    def on_token(key: str, alive: bool) -> None:
        events.append((key, alive))
        threads.add(threading.current_thread().name)

    def both_received() -> bool:
        send(b"1")
        return bool(pings and events)

    with listen(endpoint) as slave, open_master_session(endpoint) as master:
        slave.receive("ping", ping, 16)
        slave.watch_tokens("alive/**", on_token)
        send = master.sender("ping")
        withdraw = master.declare_token("alive/1")
        assert wait_for(both_received)
        withdraw()
        assert wait_for(lambda: len(events) == 2)
        time.sleep(0.1)
        before = wakeups("worker")
        time.sleep(0.5)
        assert wakeups("worker") - before <= 1, "a channel of the library would have woken it five times"
    assert events == [("alive/1", True), ("alive/1", False)]
    assert threads == {"worker"}
    assert not [thread for thread in threading.enumerate() if thread.name == "worker"]
