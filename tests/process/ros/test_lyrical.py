"""ROS 2 Lyrical and later: publishers that send sequences of numbers on keys of their own, and services of 2.x."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import zenoh

from hil.client.client import VehicleClient
from hil.client.topics import Arrivals
from hil.common.stop import StopSignals
from hil.network.roles import open_master_session
from hil.recording.tap import Tap
from hil.ros import encoders as ros
from hil.ros import graph
from hil.ros.fleet import Message, encode_message
from hil.ros.topics import TOPICS, hash_of
from tests.support.network.rmw import session_settings
from tests.support.processes import free_port, wait_for

TOPIC = TOPICS["modem_rx"]
NAME = TOPIC.full_name("uuv1")


@contextmanager
def lyrical_publisher(endpoint: str) -> Iterator[None]:
    """Publish as rmw_zenoh 0.10.5 does (PublisherData::publish): on the usual key only for older subscribers."""
    settings = zenoh.Config.from_json5(session_settings(endpoint))
    settings.insert_json5("listen/endpoints", f'["{endpoint}"]')
    settings.insert_json5("connect/endpoints", "[]")
    ended = threading.Event()
    with zenoh.open(settings) as session:
        zid = str(session.info.zid())
        entity = graph.Entity("MP", "/acoustics", zid, 0, 1, NAME, TOPIC.type, hash_of(TOPIC.type))
        token = session.liveliness().declare_token(f"{graph.token(entity)}/cpu:")
        key = ros.data_key(0, NAME, TOPIC.type, hash_of(TOPIC.type))

        payload = encode_message(Message("uuv2", b"here"))

        def run() -> None:
            number = 0
            while not ended.wait(0.02):
                replies = session.liveliness().get(graph.SUBSCRIPTIONS, zenoh.handlers.FifoChannel(64), timeout=1.0)
                tokens = [str(reply.ok.key_expr).split("/") for reply in replies if reply.ok]
                older = [parts for parts in tokens if len(parts) == 13 and parts[9] == NAME.replace("/", "%")]
                number += 1
                attachment = ros.pack_attachment(number, number, bytes(16))
                session.put(key if older else f"{key}/_buf_cpu", payload, attachment=attachment)

        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()
            token.undeclare()


def tapped(endpoint: str) -> Iterator[Callable[[], object]]:
    with Tap([endpoint]) as tap:
        yield lambda: [message for message in tap.receive() if message.topic == NAME]


def echoed(endpoint: str) -> Iterator[Callable[[], object]]:
    with open_master_session(endpoint) as session, StopSignals() as stop_fd:
        arrivals = Arrivals(session, NAME, latched=False)
        yield lambda: arrivals.receive(stop_fd, 0.1)


def received_by_a_client(endpoint: str) -> Iterator[Callable[[], object]]:
    with VehicleClient(endpoint, "uuv1", topics=("modem_rx",)) as client:
        yield lambda: client.received["modem_rx"]


@pytest.mark.parametrize("subscribe", [tapped, echoed, received_by_a_client])
def test_messages_of_a_buffered_publisher_are_received(
    subscribe: Callable[[str], Iterator[Callable[[], object]]], tmp_path: Path
) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with lyrical_publisher(endpoint), contextmanager(subscribe)(endpoint) as received:
        assert wait_for(received)
