"""What a loop publishes on a network that cannot carry it."""

import time
from collections import Counter

from hil.slave.outbox import Outbox
from hil.transport.presence import fetch_last, serve_last
from hil.transport.roles import dial
from hil.transport.session import listen
from tests.processes import free_port, wait_for
from tests.relay import Relay

LASER, IMU = bytes(60_000), bytes(300)


def test_large_messages_hold_up_neither_the_loop_nor_small_ones() -> None:
    port = free_port()
    heard, last, longest_ns = Counter[str](), dict[str, bytes](), 0
    with listen(f"tcp/127.0.0.1:{port}") as slave, Relay(port, 0.4e6) as relay, dial(relay.endpoint) as master:
        outbox = Outbox(slave, "uuv1", 0)
        serve_last(slave, "uuv1")
        master.subscribe("uuv1", "*", lambda topic, *_: heard.update([topic]), depth=64)
        assert wait_for(slave.audience("0/uuv1/**"), 10)
        for step in range(300):
            began = time.monotonic_ns()
            outbox.put("imu", IMU)
            if step % 10 == 0:
                outbox.put("laser", LASER)  # 600 kB a second
            longest_ns = max(longest_ns, time.monotonic_ns() - began)
            if step == 150:
                fetch_last(master, "uuv1", lambda topic, payload, _: last.update({topic: payload}))
            time.sleep(0.01)
        assert wait_for(lambda: heard["laser"] > 2, 10), "as many as it carries"
    assert longest_ns < 25e6
    assert heard["imu"] > 250
    assert outbox.sent == 330, "those that were left out are missing in the numbers"
    assert last == {"imu": IMU}, "what is large is not kept for who comes late"
