"""Simulate the modem channel of a fleet over the network: deliver on `modem_rx` what vehicles send on `modem_tx`.

A member with `usbl` gets on `modem_position` where it has found another one.

Only the simulator knows the true position of every vehicle. A message arrives after its travel time, or is lost.
"""

import threading
from collections import Counter

from hil.common.clock import now_ns, to_wall_ns
from hil.common.vectors import Vector3
from hil.network.session import Session
from hil.ros import encoders as ros
from hil.ros.fleet import Message, decode_message, encode_message, encode_place, encode_range
from hil.ros.graph import Node
from hil.ros.topics import TOPICS
from hil.scenario.config import Scenario
from hil.scenario.modem import open_channel, open_usbl
from sim.sensors.extra_samples import PositionSample

TICK_S = 0.005  # period of the delivery of messages
QUEUE = 16
MAX_RANGE_M = 1e4  # upper bound of the range in each message of a measured distance


class ModemNetwork:
    """Serve the modems of a scenario's members until the session is closed. Raises ConfigError.

    A vehicle without a known position neither sends nor receives. `ranges` has the last measured distance (m) from one
    vehicle to another.
    """

    def __init__(self, session: Session, scenario: Scenario) -> None:
        self.ranges: dict[tuple[str, str], float] = {}
        self._channel = open_channel(scenario)
        self._usbl = open_usbl(scenario, self._channel)
        self._lock = threading.Lock()
        self._positions: dict[str, Vector3] = {}
        nodes = [member.node for member in scenario.member]
        self._received = {node: session.publisher(node, TOPICS["modem_rx"]) for node in nodes}
        self._measured = {node: session.publisher(node, TOPICS["modem_range"]) for node in nodes}
        heads = [member.node for member in scenario.member if member.usbl]
        self._located = {node: session.publisher(node, TOPICS["modem_position"]) for node in heads}
        graph = Node(session, "channel")
        for topic, publishers in (
            ("modem_rx", self._received), ("modem_range", self._measured), ("modem_position", self._located),
        ):  # fmt: skip
            for node, publisher in publishers.items():
                publisher.gid = graph.publishes(TOPICS[topic], node)
        for node in nodes:
            self._attend(session, node)
            graph.subscribes(TOPICS["modem_tx"], node)
        session.every(TICK_S, self._deliver, "channel")

    @property
    def counts(self) -> Counter[str]:
        """Number of messages by their outcome: those of the channel (sim/modems), and "malformed"."""
        with self._lock:
            return Counter(self._channel.counts)

    def _attend(self, session: Session, node: str) -> None:
        def store_position(_topic: str, payload: bytes, _attachment: bytes) -> None:
            truth = ros.decode_odometry(payload)
            if truth is not None:
                self._positions[node] = truth.position

        def send(_topic: str, payload: bytes, _attachment: bytes) -> None:
            message = decode_message(payload)
            with self._lock:
                if message is None:
                    self._channel.counts["malformed"] += 1
                elif node in self._positions:
                    self._channel.send(now_ns(), node, message.payload, dict(self._positions))

        session.subscribe(node, "ground_truth", store_position, 1)
        session.subscribe(node, "modem_tx", send, QUEUE)

    def _deliver(self) -> None:
        with self._lock:
            present, positions = now_ns(), dict(self._positions)
            self._usbl.ask(present, positions)
            packets, fixes = self._usbl.take(present, self._channel.receive(present), positions)
        for fix in fixes:
            sample = PositionSample(to_wall_ns(fix.sent_ns), fix.offset, fix.covariance)
            self._located[fix.receiver].put(encode_place(sample, fix.sender), to_wall_ns(present))
        for packet in packets:
            now = to_wall_ns(now_ns())
            self._received[packet.receiver].put(encode_message(Message(packet.sender, packet.payload)), now)
            self.ranges[packet.receiver, packet.sender] = packet.distance
            message = encode_range(now, packet.sender, packet.distance, MAX_RANGE_M)
            self._measured[packet.receiver].put(message, now)


def summary(counts: Counter[str]) -> str:
    """Return the counts as one line of text."""
    return ", ".join(f"{number} {outcome.replace('_', ' ')}" for outcome, number in counts.items()) or "nothing sent"
