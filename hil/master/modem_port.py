"""Connect the planner of one vehicle of a fleet to its modem: send reports in its slot, receive those of others.

On the network a modem consists of two topics, `modem_tx` and `modem_rx`. `uuv-hil fleet channel` connects them: it
simulates the water.
"""

from hil.common.clock import NS_PER_S, from_wall_ns, now_ns, to_wall_ns
from hil.master.hunt import HuntPlanner
from hil.network.session import Session
from hil.ros.fleet import Message, decode_message, encode_message
from hil.ros.graph import Node
from hil.ros.topics import TOPICS
from hil.scenario.config import Scenario
from hil.scenario.modem import TdmaSchedule, modem_of

QUEUE = 16


class ModemPort:
    """Modem of member `number`: it sends in its TDMA slots, and receives. `began` (monotonic ns) is its time 0.

    The slots follow the wall clock: all machines must agree on it to a fraction of a slot. Raises ConfigError.
    """

    def __init__(self, session: Session, scenario: Scenario, number: int, planner: HuntPlanner, began: int) -> None:
        self._node = scenario.member[number].node
        self._planner = planner
        self._began = began
        self._airtime_ns = modem_of(scenario).model.airtime_ns
        self._schedule = TdmaSchedule(scenario, number)
        self._out = session.publisher(self._node, TOPICS["modem_tx"])
        graph = Node(session, f"{self._node}_modem")
        self._out.gid = graph.publishes(TOPICS["modem_tx"], self._node)
        graph.subscribes(TOPICS["modem_rx"], self._node)
        session.subscribe(self._node, "modem_rx", self._on_message, QUEUE)
        self._due_ns = self._schedule.after(to_wall_ns(now_ns()))

    @property
    def deadline_ns(self) -> int:
        """Start of its next slot, monotonic ns."""
        return from_wall_ns(self._due_ns)

    def send_report(self) -> None:
        """Send the planner's report if the slot has begun and there is a report."""
        now = to_wall_ns(now_ns())
        if now < self._due_ns:
            return
        self._due_ns = self._schedule.after(now)
        if modem_report := self._planner.modem_report():
            self._out.put(encode_message(Message(self._node, modem_report)), now)

    def _on_message(self, _topic: str, payload: bytes, _attachment: bytes) -> None:
        message = decode_message(payload)
        if message is None:
            self._planner.malformed += 1
            return
        sent_ns = now_ns() - self._airtime_ns(len(message.payload))
        self._planner.on_modem_report(message.sender, message.payload, (sent_ns - self._began) / NS_PER_S)
