"""Frequent messages are sent without the text of their key, and arrive once for each pattern of subscription."""

import statistics
import threading
from itertools import pairwise

import pytest

from hil.network.opening import listen
from hil.network.roles import open_master_session
from hil.ros.topics import TOPICS
from tests.support.processes import free_port, wait_for
from tools.faults.relay import Relay

NUMBER = 50
PAYLOAD = bytes(48)
BESIDE = 33 + 25  # bytes: the attachment, and what the library says of a message
TEXT = 90  # bytes of each of these keys, or more


@pytest.mark.parametrize(
    ("pattern", "name"),
    [("cmd_$*", "cmd_vel"), ("cmd_$*", "cmd_thrusters"), ("odom", "odom"), ("*", "imu"), ("*", "ground_truth")],
)
@pytest.mark.parametrize("hearing", ["slave", "master"])
def test_the_key_of_frequent_messages_is_sent_as_a_number(pattern: str, name: str, hearing: str) -> None:
    port, received, payloads = free_port(), list[str](), list[bytes]()
    came = threading.Event()
    with listen(f"tcp/127.0.0.1:{port}") as slave, Relay(port) as relay, open_master_session(relay.endpoint) as master:
        hears, says = (slave, master) if hearing == "slave" else (master, slave)
        publisher = says.publisher("uuv1", TOPICS[name])  # before anybody wants it

        def receive(topic: str, payload: bytes, _: bytes) -> None:
            received.append(topic)
            payloads.append(payload)
            came.set()

        hears.subscribe("uuv1", pattern, receive, NUMBER)

        def arrives() -> bool:
            """Publish until a message arrives: one that finds others still to be sent is dropped, and sent again."""
            payload = publisher.sequence.to_bytes(len(PAYLOAD), "big")
            came.clear()
            publisher.put(payload, 0)
            return came.wait(0.5) and payloads[-1] == payload

        assert wait_for(arrives), "those before it have come too, or never will"
        passed = [relay.passed]
        for _ in range(NUMBER):
            assert wait_for(arrives)
            passed.append(relay.passed)
        each = statistics.median([after - before for before, after in pairwise(passed)])
        assert len(PAYLOAD) < each < len(PAYLOAD) + BESIDE + TEXT / 2, passed
        assert set(received) == {name}
        assert len(payloads) == len(set(payloads)), "once"
