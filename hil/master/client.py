"""A vehicle as a planner sees it: its newest samples, and commands to it."""

import threading
from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple, Self

from hil.autonomy.control import VelocityCommand
from hil.clock import NS_PER_S, now_ns, to_wall_ns
from hil.errors import NetworkError
from hil.master.contact import Contact
from hil.master.delay import DelayMeter
from hil.process import boot_id
from hil.topics import ALL, TOPICS, is_picture
from hil.transport import ros
from hil.transport.graph import Node
from hil.transport.presence import fetch_last
from hil.transport.roles import dial
from hil.transport.security import Security
from hil.transport.session import Session
from hil.transport.settings import Network

QUEUE = 256  # messages that may wait for the reader; beyond it the oldest are dropped
PICTURES = 2  # of one topic that may wait
OWN = ("diagnostics", "trace")  # what a client listens to for itself
CLOCK_WAIT_S = 0.3  # that the last state of a vehicle may wait until its age is known
HOLDS_ON = 2  # diagnostics in a row that name another master: it is not about to give way


class Stamped(NamedTuple):
    """A message, when it came and when it was sent (monotonic ns of this machine)."""

    value: Any
    received_ns: int
    sent_ns: int

    @property
    def age_s(self) -> float:
        """Seconds since it was sent."""
        return (now_ns() - self.sent_ns) / NS_PER_S


def _silence(_: str) -> None:
    """Report nothing."""


def _ignore(_topic: str, _: Stamped) -> None:
    """Do nothing with a message."""


class VehicleClient:
    """One vehicle, over a session. Use as a context; leaving it stops the vehicle and closes what was opened here.

    `where` is the endpoint of the slave or of a router, or a session that several clients share. A `part` of
    "observer" never commands. A master of higher `rank` (0 to 9) takes the vehicle over from another. `report` gets a
    line when the vehicle comes and goes; the session finds it again by itself. `heard` gets each message that is kept,
    and may be called in several threads. `topics` are those it listens to from the beginning, `watch` adds others; what
    nobody listens to is not sent.

    `latest` holds the newest message of each topic, in NED and FRD; `received` counts them; `malformed`
    counts what could not be decoded; `delays` measures the newest commands; `contact` knows whether the vehicle is
    there.
    """

    def __init__(
        self,
        where: str | Session,
        node: str,
        *,
        part: Literal["master", "observer"] = "master",
        rank: int = 0,
        network: Network = Network(),
        security: Security | None = None,
        report: Callable[[str], None] = _silence,
        heard: Callable[[str, Stamped], None] = _ignore,
        topics: Sequence[str] = (ALL,),
    ) -> None:
        self.node = node
        self._heard = heard
        self.latest: dict[str, Stamped] = {}
        self.received = dict.fromkeys(TOPICS, 0)
        self.malformed = 0
        self._watched: set[str] = set()
        self._watching = threading.Lock()  # two who want the same topic at once must not get it twice
        self.delays = DelayMeter()
        self.first_sample_wall_ns = 0
        self._first_sample = threading.Event()
        self._rank = rank
        self._certificate = security.name("master") if security else ""
        self._named_other = 0  # diagnostics in a row
        self._named_before = False  # by the last diagnostics before we came
        self._owns_session = isinstance(where, str)
        self._session = dial(where, network=network, security=security) if isinstance(where, str) else where
        self.endpoint = self._session.name
        self.dialled_wall_ns = to_wall_ns(now_ns())
        self._commands = self._session.publisher(node, TOPICS["cmd_vel"])
        self._publishers = {"cmd_vel": self._commands}
        self.contact = Contact(self._session, node, self.delays.clock, self._fetch_last, report, network.lease)
        self.watch(*topics, *OWN)
        self.contact.begin(part, self._commands.gid, rank)
        self._graph = Node(self._session, f"{node}_{part}")  # as ROS sees us
        if part == "master":
            self._graph.publishes(TOPICS["cmd_vel"], node)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Command standstill if we have commanded, leave, and close the session if it was opened here."""
        if self.has_commanded:
            self.command(VelocityCommand())
        self._graph.leave()
        self.contact.end()
        if self._owns_session:
            self._session.close()

    @property
    def has_commanded(self) -> bool:
        """Whether a command has been sent."""
        return any(publisher.sequence for publisher in self._publishers.values())

    def command(self, command: VelocityCommand) -> int:
        """Send a velocity command (FRD, m/s, rad/s), `depth` and `heading` before it; its sequence number."""
        for topic, value in (("cmd_depth", command.depth), ("cmd_heading", command.heading)):
            if value is not None:
                from hil.transport.ros_commands import encode_number  # most commands do without

                self.send(topic, encode_number(value))
        linear = (command.surge, command.sway, command.heave)
        return self.send("cmd_vel", ros.encode_twist(linear, (0.0, 0.0, command.yaw_rate)))

    def send(self, topic: str, payload: bytes) -> int:
        """Send a message on one of the topics of commands; its sequence number there."""
        if not self.has_commanded:
            self._named_other = 0
        publisher = self._publishers.get(topic)
        if publisher is None:
            publisher = self._publishers[topic] = self._session.publisher(self.node, TOPICS[topic])
            publisher.gid = self._commands.gid  # by which the slave knows that they are of one master
            self._graph.publishes(TOPICS[topic], self.node)
        return publisher.put(payload, to_wall_ns(now_ns()))

    def watch(self, *topics: str) -> None:
        """Listen to these topics too; pictures ("camera/image_raw") only come to those who ask for them by name."""
        for topic in sorted(topics, key=ALL.__ne__):  # all first, which has the others in it: none is to come twice
            with self._watching:
                if self._listens(topic):
                    continue
                self._watched.add(topic)
                self._session.subscribe(self.node, topic, self._deliver, PICTURES if is_picture(topic) else QUEUE)
            if self.contact.present and not is_picture(topic):
                fetch_last(self._session, self.node, self._deliver_last, topic)  # some come once a second

    def offers(self) -> set[str]:
        """The topics it has said anything on, listened to or not; asked for here and now."""
        topics: set[str] = set()
        fetch_last(self._session, self.node, lambda topic, *_: topics.add(topic))
        return topics

    def wait_for_vehicle(self, seconds: float) -> bool:
        """Wait for the first sample; whether it came within `seconds`."""
        return self._first_sample.wait(seconds)

    def get(self, topic: str, within_s: float = 1.0) -> Any:
        """The newest message of a topic. Raises NetworkError if none came or it is older than `within_s`."""
        stamped = self.latest.get(topic)
        if stamped is None:
            raise NetworkError(f"{self.node} at {self.endpoint} has sent no {topic}")
        if stamped.age_s > within_s:
            raise NetworkError(f"{self.node} at {self.endpoint} is gone: no {topic} for {stamped.age_s:.1f} s")
        return stamped.value

    def diagnostics(self) -> dict[str, str]:
        """The slave's figures of health as it last published them; empty before the first."""
        stamped = self.latest.get("diagnostics")
        return stamped.value if stamped else {}

    @property
    def in_doubt(self) -> bool:
        """Whether it has named another master, who may have left since: its next diagnostics tell."""
        return not self._rank and (self._named_before or 0 < self._named_other < HOLDS_ON)

    def refusal(self) -> str:
        """Why the vehicle does not obey us, and the remedy; "" while nothing says so."""
        values = self.diagnostics()
        may_command = values.get("may_command", "").split()
        if self._certificate and may_command and self._certificate not in may_command:
            return (
                f"{self.node} obeys {', '.join(may_command)} only, and the certificate of this machine says "
                f"{self._certificate!r}: add it to may_command in the [security] section of the slave's scenario"
            )
        if self._named_other >= HOLDS_ON and (self.has_commanded or not self._rank):
            return (
                f"{self.node} obeys another master, {values.get('commander') or 'a stranger'}; end that one first, "
                "or take over with --take-over (in Python take_over=True)"
            )
        return ""

    def _deliver(self, topic: str, payload: bytes, attachment: bytes) -> None:
        received_ns = now_ns()
        decode = ros.decoder(topic)
        if decode is None:  # that of a sensor of a user's own, whose scenario was not read here
            return
        value = decode(payload)
        stamp = ros.unpack_attachment(attachment)
        if value is None or stamp is None:
            self.malformed += 1
            return
        self.received[topic] = self.received.get(topic, 0) + 1
        if topic == "trace":
            self.delays.add(value, stamp.time_ns, to_wall_ns(received_ns))
            return
        if topic == "diagnostics":
            value = value[0][3] if value else {}
            self._judge(value)
        kept = self.latest[topic] = Stamped(value, received_ns, self.contact.sent_ns(stamp.time_ns, received_ns))
        self._heard(topic, kept)
        if not self.first_sample_wall_ns and topic != "diagnostics":
            self.first_sample_wall_ns = to_wall_ns(received_ns)
            self._first_sample.set()

    def _listens(self, topic: str) -> bool:
        return topic in self._watched or (ALL in self._watched and not is_picture(topic))

    def _judge(self, diagnostics: dict[str, str]) -> None:
        self.contact.same_clock = diagnostics.get("boot_id") == boot_id()
        other = diagnostics.get("commanded_by", "") not in ("", self._commands.gid.hex())
        self._named_other = self._named_other + 1 if other else 0
        self._named_before = False

    def _fetch_last(self) -> None:
        """The last state of a vehicle that has just come, so that slow topics need not be waited for."""
        self.contact.known.wait(CLOCK_WAIT_S)
        fetch_last(self._session, self.node, self._deliver_last)

    def _deliver_last(self, topic: str, payload: bytes, attachment: bytes) -> None:
        if topic not in self.latest and topic != "trace" and self._listens(topic):
            self._deliver(topic, payload, attachment)
            if topic == "diagnostics" and self._named_other:
                self._named_other, self._named_before = 0, True
