"""What comes often goes without the text of its key, and arrives once, whatever pattern it was subscribed to by."""

import time

import pytest

from hil.network.roles import open_master_session
from hil.network.session import listen
from hil.ros.topics import TOPICS
from tests.support.busy import retried_when_busy
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
@retried_when_busy("a network that gets no turn drops messages, as it shall")
def test_a_key_on_which_messages_come_often_goes_as_a_number(pattern: str, name: str, hearing: str) -> None:
    port, heard, payloads = free_port(), list[str](), list[bytes]()
    with listen(f"tcp/127.0.0.1:{port}") as slave, Relay(port) as relay, open_master_session(relay.endpoint) as master:
        hears, says = (slave, master) if hearing == "slave" else (master, slave)
        publisher = says.publisher("uuv1", TOPICS[name])  # before anybody wants it

        def hear(topic: str, payload: bytes, _: bytes) -> None:
            heard.append(topic)
            payloads.append(payload)

        hears.subscribe("uuv1", pattern, hear, NUMBER)
        assert wait_for(lambda: publisher.put(PAYLOAD, 0) and heard)
        publisher.put(b"the last", 0)
        assert wait_for(lambda: payloads[-1] == b"the last"), "those under way have come"
        lost = publisher.sequence - len(heard)
        before = relay.passed
        for _ in range(NUMBER):
            publisher.put(PAYLOAD, 0)
            time.sleep(0.005)
        assert wait_for(lambda: len(heard) == publisher.sequence - lost)
        time.sleep(0.1)
        each = (relay.passed - before) / NUMBER
        assert len(PAYLOAD) < each < len(PAYLOAD) + BESIDE + TEXT / 2
        assert heard == [name] * (publisher.sequence - lost)
