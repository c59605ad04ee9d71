"""The modem of one vehicle of a fleet, as its planner has it: what it is given, and what it has heard.

On the network the modem is two topics, `modem_tx` and `modem_rx`, which `uuv-hil water` connects in place of the sea.
"""

from hil.clock import NS_PER_S, from_wall_ns, now_ns, to_wall_ns
from hil.config import Scenario
from hil.master.hunt import HuntPlanner
from hil.modem import Turns, modem_of
from hil.topics import TOPICS
from hil.transport.graph import Node
from hil.transport.ros_modem import Message, decode_message, encode_message
from hil.transport.session import Session

QUEUE = 16


class ModemVoice:
    """Lets the planner of member `number` send in its turn, and hear. `began` (monotonic ns) is its time 0.

    Turns go by the wall clock: machines have to agree on it to a fraction of a slot. Raises ConfigError.
    """

    def __init__(self, session: Session, scenario: Scenario, number: int, planner: HuntPlanner, began: int) -> None:
        self._node = scenario.member[number].node
        self._planner = planner
        self._began = began
        self._airtime_ns = modem_of(scenario).model.airtime_ns
        self._turns = Turns(scenario, number)
        self._out = session.publisher(self._node, TOPICS["modem_tx"])
        graph = Node(session, f"{self._node}_modem")
        graph.publishes(TOPICS["modem_tx"], self._node)
        graph.subscribes(TOPICS["modem_rx"], self._node)
        session.subscribe(self._node, "modem_rx", self._hear, QUEUE)
        self._due_ns = self._turns.after(to_wall_ns(now_ns()))

    @property
    def deadline_ns(self) -> int:
        """When its next turn is, monotonic."""
        return from_wall_ns(self._due_ns)

    def speak(self) -> None:
        """Send, if it is its turn and there is something to say."""
        now = to_wall_ns(now_ns())
        if now < self._due_ns:
            return
        self._due_ns = self._turns.after(now)
        if telegram := self._planner.telegram():
            self._out.put(encode_message(Message(self._node, telegram)), now)

    def _hear(self, _topic: str, payload: bytes, _attachment: bytes) -> None:
        message = decode_message(payload)
        if message is None:
            self._planner.malformed += 1
            return
        sent_ns = now_ns() - self._airtime_ns(len(message.payload))
        self._planner.overhear(message.sender, message.payload, (sent_ns - self._began) / NS_PER_S)
