"""Frequent messages are sent without the text of their key, and arrive once for each pattern of subscription."""

import statistics
import threading
from itertools import pairwise

import pytest

from hil.network import session
from hil.network.opening import listen
from hil.network.roles import open_master_session
from hil.ros.topics import TOPICS
from tests.support.processes import free_port, wait_for
from tools.faults.relay import Relay

NUMBER = 50
PAYLOAD = bytes(48)
OVERHEAD_BYTES = 33 + 25  # bytes: the attachment, and the library's header of a message
KEY_TEXT_BYTES = 90  # bytes of each of these keys, or more


def bytes_of_a_message(pattern: str, name: str, receiving: str) -> float:
    """Send a topic to a subscriber of `pattern`; return the bytes of each message on the network."""
    port, received, payloads = free_port(), list[str](), list[bytes]()
    arrived = threading.Event()
    with listen(f"tcp/127.0.0.1:{port}") as slave, Relay(port) as relay, open_master_session(relay.endpoint) as master:
        receiver, sender = (slave, master) if receiving == "slave" else (master, slave)
        publisher = sender.publisher("uuv1", TOPICS[name])  # before there is a subscriber

        def receive(topic: str, payload: bytes, _: bytes) -> None:
            received.append(topic)
            payloads.append(payload)
            arrived.set()

        receiver.subscribe("uuv1", pattern, receive, NUMBER)

        def arrives() -> bool:
            """Publish a message and return whether it arrives; it is dropped while others wait to be sent."""
            payload = publisher.sequence.to_bytes(len(PAYLOAD), "big")
            arrived.clear()
            publisher.put(payload, 0)
            return arrived.wait(0.5) and payloads[-1] == payload

        assert wait_for(arrives), "earlier messages have arrived too, or are lost"
        passed_counts = [relay.passed]
        for _ in range(NUMBER):
            assert wait_for(arrives)
            passed_counts.append(relay.passed)
        each = statistics.median([after - before for before, after in pairwise(passed_counts)])
        assert set(received) == {name}
        assert len(payloads) == len(set(payloads)), "each arrives once"
        return each - len(PAYLOAD)


@pytest.mark.parametrize(
    ("pattern", "name", "receiving"),
    [
        ("cmd_$*", "cmd_vel", "slave"),
        ("cmd_$*", "cmd_thrusters", "slave"),
        ("odom", "odom", "master"),
        ("*", "imu", "master"),
        ("*", "ground_truth", "master"),
    ],
)
def test_the_key_of_frequent_messages_is_sent_as_a_number(pattern: str, name: str, receiving: str) -> None:
    assert 0 < bytes_of_a_message(pattern, name, receiving) < OVERHEAD_BYTES + KEY_TEXT_BYTES / 2


def test_a_subscriber_with_wildcards_gets_the_text_of_each_key(monkeypatch: pytest.MonkeyPatch) -> None:
    """Remove `hil.network.workarounds.key_text` if this fails: the library sends numbers without it."""
    monkeypatch.setattr(session, "frequent_keys", lambda *_: [])
    assert bytes_of_a_message("*", "imu", "master") > KEY_TEXT_BYTES
