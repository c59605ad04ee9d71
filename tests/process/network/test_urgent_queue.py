"""Urgent messages of a slave while the network is blocked: queued in order, and no more than the queue holds."""

from hil.network.opening import listen
from hil.network.roles import open_master_session
from hil.network.settings import BATCH, URGENT_BATCHES
from hil.ros.topics import TOPICS
from tests.support.processes import free_port, wait_for
from tools.faults.relay import Relay

SENT = 400
SIZE = BATCH - 192  # one fills a batch: the kernel's buffers take few
LAST = 1 << 16


def test_urgent_messages_are_queued_in_order_within_bounds() -> None:
    port, received = free_port(), list[int]()
    with (
        listen(f"tcp/127.0.0.1:{port}") as slave,
        Relay(port) as relay,
        open_master_session(relay.endpoint) as master,
    ):
        publisher = slave.publisher("uuv1", TOPICS["trace"])

        def send(number: int, size: int = 4) -> None:
            publisher.put(number.to_bytes(4, "little") + bytes(size), 0)

        def is_received(number: int) -> bool:
            send(number)
            return number in received

        master.subscribe(
            "uuv1", "trace", lambda _, payload, __: received.append(int.from_bytes(payload[:4], "little")), depth=1000
        )
        assert wait_for(lambda: is_received(0))
        relay.hold()
        for number in range(1, SENT + 1):
            send(number, SIZE)
        relay.release()
        assert wait_for(lambda: is_received(LAST))
    arrived = [number for number in received if 0 < number < LAST]
    assert arrived == sorted(set(arrived))
    assert URGENT_BATCHES <= len(arrived) < SENT / 2, "the queue's, and what the kernel's buffers hold besides"
