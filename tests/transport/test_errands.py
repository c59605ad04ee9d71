"""One thread for all that comes seldom: in order, bounded, and without a wake-up while nothing comes."""

import threading
import time
from pathlib import Path

import pytest

from hil.clock import NS_PER_S
from hil.transport.errands import Errands
from hil.transport.roles import dial
from hil.transport.session import listen
from tests.processes import free_port, wait_for


def test_items_are_used_in_order_and_beyond_the_most_are_lost() -> None:
    errands, few, all_ = Errands(), list[int](), list[int]()
    some, every = errands.handler(few.append, 3), errands.handler(all_.append, float("inf"))
    for number in range(5):
        some(number)
    for number in range(5):
        every(number)
    errands.end()
    errands.run()
    assert (few, all_) == ([0, 1, 2], [0, 1, 2, 3, 4])


def test_beyond_the_rate_items_are_lost_until_the_second_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    now = NS_PER_S
    monkeypatch.setattr("hil.transport.errands.now_ns", lambda: now)
    errands, used = Errands(), list[int]()
    door = errands.door(used.append, 6, 2)
    for number in range(12):
        now += NS_PER_S // 4
        door.take(number)
    errands.end()
    errands.run()
    assert used == [0, 1, 4, 5, 8, 9]
    assert door.lost == 6
    now += NS_PER_S
    full = errands.door(used.append, 0, 2)
    full.take(12)
    assert full.lost == 1, "what finds no room is counted too"


def test_what_raises_loses_its_item_and_is_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    errands, used, told = Errands(), list[float](), list[threading.ExceptHookArgs]()
    monkeypatch.setattr(threading, "excepthook", told.append)
    divide = errands.queue(lambda number: used.append(1 / number), float("inf"))
    for number in (1, 0, 2, 0, 4):
        divide(number)
    errands.end()
    errands.run()
    assert used == [1.0, 0.5, 0.25]
    assert errands.failures == 2
    assert [args.exc_type for args in told] == [ZeroDivisionError]


def wakeups(name: str) -> int:
    """How often a thread of this process has slept."""
    thread = next(thread for thread in threading.enumerate() if thread.name == name)
    status = Path(f"/proc/self/task/{thread.native_id}/status").read_text()
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("voluntary_ctxt"))


def test_pings_and_presence_share_a_thread_which_sleeps_while_nothing_comes() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    pings, there, threads = list[bytes](), list[tuple[str, bool]](), set[str]()

    def ping(payload: bytes) -> None:
        pings.append(payload)
        threads.add(threading.current_thread().name)

    def meet(key: str, alive: bool) -> None:
        there.append((key, alive))
        threads.add(threading.current_thread().name)

    def both() -> bool:
        send(b"1")
        return bool(pings and there)

    with listen(endpoint) as slave, dial(endpoint) as master:
        slave.receive("ping", ping, 16)
        slave.watch_tokens("alive/**", meet)
        send = master.sender("ping")
        withdraw = master.declare_token("alive/1")
        assert wait_for(both, 3)
        withdraw()
        assert wait_for(lambda: len(there) == 2, 3)
        time.sleep(0.1)
        before = wakeups("errands")
        time.sleep(0.5)
        assert wakeups("errands") - before <= 1, "a channel of the library would have woken it five times"
    assert there == [("alive/1", True), ("alive/1", False)]
    assert threads == {"errands"}
    assert not [thread for thread in threading.enumerate() if thread.name == "errands"]
