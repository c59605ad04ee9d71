"""Connect a planner to one vehicle: receive its newest samples, send it commands."""

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from hil.autonomy.control.controller import VelocityCommand
from hil.client.delay import DelayMeter
from hil.client.liveness import LivenessMonitor
from hil.common.clock import NS_PER_S, boot_id, now_ns, to_wall_ns
from hil.common.errors import NetworkError
from hil.network.buffered import join_publishers
from hil.network.presence import fetch_last
from hil.network.publisher import Publisher
from hil.network.roles import open_master_session
from hil.network.security import Security
from hil.network.session import Session
from hil.network.settings import Network
from hil.ros import dialect
from hil.ros import encoders as ros
from hil.ros.diagnostics import Diagnostics
from hil.ros.graph import Node
from hil.ros.topics import ALL, DESCRIPTIONS, TOPICS, is_picture
from sim.run_events import RunEvent, events_since

if TYPE_CHECKING:
    from typing_extensions import Self

QUEUE = 256  # messages that may wait for the reader; beyond it the oldest are dropped
PICTURES = 2  # pictures of one topic that may wait
OWN = ("diagnostics", "trace")  # topics that a client needs itself
CLOCK_WAIT_S = 0.3  # wait for the clock offset before the last messages are fetched, so that their age is known
URGENT = ("trace",)  # topics on the link of commands and answers, which do not show that the link of samples works
SOFTWARE_WITHIN_NS = 3 * NS_PER_S  # time for external control software to react to our commands
REFUSED_NS = 3 * NS_PER_S  # a refusal that lasts this long is final; at least two diagnostics come meanwhile
POLL_S = 0.02
HOLDS_ON = 2  # diagnostics in a row that name another master; after these it is not about to leave


class Stamped(NamedTuple):
    """A message with its times of reception and of sending (monotonic ns of this machine)."""

    value: Any
    received_ns: int
    sent_ns: int

    @property
    def age_s(self) -> float:
        """Seconds since it was sent."""
        return (now_ns() - self.sent_ns) / NS_PER_S


class _FirstSample(NamedTuple):
    """The first message of a publisher, with its send time (vehicle's clock) and receive time (ours)."""

    gid: bytes
    sent_wall_ns: int
    received_wall_ns: int


class VehicleClient:
    """One vehicle, over a session. Use as a context manager; leaving it stops the vehicle and closes what it opened.

    `where` is the endpoint of the slave or of a router, or a session that several clients share. With `role` "observer"
    the client never commands. A master with a higher `rank` (0 to 9) takes the vehicle over from another. `report` gets
    a line when the vehicle appears or is lost; the session reconnects by itself. `on_sample` gets each message, in
    several threads. `topics` are subscribed at the start; `watch` adds others. Topics without a subscriber are not
    sent.

    Attributes: `latest`: newest message by topic, in NED and FRD. `received`: number of messages by topic. `malformed`:
    number of messages that could not be decoded. `delays`: delays of the newest commands. `contact`: whether the
    vehicle is present. `session`: the session to it.
    """

    def __init__(
        self,
        where: str | Session,
        node: str,
        *,
        role: Literal["master", "observer"] = "master",
        rank: int = 0,
        network: Network = Network(),
        security: Security | None = None,
        report: Callable[[str], None] = lambda _: None,
        on_sample: Callable[[str, Stamped], None] = lambda *_: None,
        topics: Sequence[str] = (ALL,),
    ) -> None:
        self.node = node
        self._on_sample = on_sample
        self.latest: dict[str, Stamped] = {}
        self.received = dict.fromkeys(TOPICS, 0)
        self.malformed = 0
        self._watched: set[str] = set()
        self._announced: set[str] = set()
        self._watching = threading.Lock()  # so that two threads do not subscribe to the same topic twice
        self.delays = DelayMeter()
        self._senders: dict[str, bytes] = {}  # topic -> gid of the publisher of the newest message
        self._first_samples: dict[str, _FirstSample] = {}  # topic -> first message since the vehicle's last start
        self._first_sample = threading.Event()
        self._rank = rank
        self._certificate = security.name("master") if security else ""
        self._named_other = 0  # number of diagnostics in a row that name another master
        self._named_before = False  # the last diagnostics before our connection named another master
        self._undriven_ns = 0  # since when (monotonic) our commands have not moved the thrusters
        self._owns_session = isinstance(where, str)
        self.session = (
            open_master_session(where, network=network, security=security) if isinstance(where, str) else where
        )
        self.endpoint = self.session.name
        self.opened_wall_ns = to_wall_ns(now_ns())
        self._commands = self.session.publisher(node, TOPICS["cmd_vel"])
        self._publishers = {"cmd_vel": self._commands}
        self._other_publishers: dict[str, Publisher] = {}  # publishers of topics other than commands
        self._graph = Node(self.session, f"{node}_{role}")  # this client in the ROS graph
        self.contact = LivenessMonitor(self.session, node, self.delays.clock, self._fetch_last, report, network.lease)
        join_publishers(self.session, f"{dialect.domain()}/{node}/**", f"{node}_{role}")
        self.watch(*topics, *OWN)
        if role == "master":
            self._commands.gid = self._graph.publishes(TOPICS["cmd_vel"], node)
        self.contact.begin(role, self._commands.gid, rank)

    def __enter__(self) -> "Self":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop the vehicle if we have commanded, withdraw our presence, and close the session if opened here."""
        if self.has_commanded:
            with suppress(NetworkError):  # two vehicles of the same name stop by their deadman
                self.command(VelocityCommand())
        self._graph.leave()
        self.contact.end()
        if self._owns_session:
            self.session.close()

    @property
    def has_commanded(self) -> bool:
        """True once a command has been sent."""
        return any(publisher.sequence for publisher in self._publishers.values())

    def command(self, command: VelocityCommand) -> int:
        """Send a velocity command (FRD, m/s, rad/s), after its `depth` and `heading`; return its sequence number."""
        for topic, value in (("cmd_depth", command.depth), ("cmd_heading", command.heading)):
            if value is not None:
                from hil.ros.commands import encode_number  # not needed by most commands

                self.send(topic, encode_number(value))
        linear = (command.surge, command.sway, command.heave)
        return self.send("cmd_vel", ros.encode_twist(linear, (0.0, 0.0, command.yaw_rate)))

    def send(self, topic: str, payload: bytes) -> int:
        """Send a message on a command topic; return its sequence number there.

        Raises NetworkError if several slaves have the vehicle's name, as all of them would execute it.
        """
        if self.contact.rivals:
            raise NetworkError(self.refusal())
        if not self.has_commanded:
            self._named_other, self._undriven_ns = 0, now_ns()
        publisher = self._publishers.get(topic)
        if publisher is None:
            publisher = self._publishers[topic] = self.session.publisher(self.node, TOPICS[topic])
            publisher.gid = self._graph.publishes(TOPICS[topic], self.node)
            publisher.master = self._commands.gid
        return publisher.put(payload, to_wall_ns(now_ns()))

    def publish(self, topic: str, payload: bytes) -> None:
        """Publish a message that is not a command on a topic of the vehicle, for observers."""
        publisher = self._other_publishers.get(topic)
        if publisher is None:
            publisher = self._other_publishers[topic] = self.session.publisher(self.node, TOPICS[topic])
            publisher.gid = self._graph.publishes(TOPICS[topic], self.node)
        publisher.put(payload, to_wall_ns(now_ns()))

    def watch(self, *topics: str) -> None:
        """Subscribe to these topics too. Pictures ("camera/image_raw") are received only if they are named here.

        The vehicle makes a description ("map") only after it was named here.
        """
        for topic in sorted(topics, key=ALL.__ne__):  # ALL first, as it includes the others
            with self._watching:
                self.announce(topic)
                if topic in self._watched or (topic not in DESCRIPTIONS and self._is_watched(topic)):
                    continue  # ALL includes a description only if the vehicle makes it later
                self._watched.add(topic)
                apart = topic in (ALL, *DESCRIPTIONS) or is_picture(topic)
                deliver = self._deliver if apart else self._deliver_unless_all
                self.session.subscribe(self.node, topic, deliver, PICTURES if is_picture(topic) else QUEUE)
            if self.contact.present and not is_picture(topic):
                fetch_last(self.session, self.node, self._deliver_last, topic)  # some topics have a period of 1 s

    def announce(self, topic: str) -> None:
        """Declare a subscription to a description in the ROS graph, which makes the vehicle publish it."""
        if topic in DESCRIPTIONS and topic not in self._announced:
            self._announced.add(topic)
            self._graph.subscribes(TOPICS[topic], self.node)

    def offers(self) -> set[str]:
        """Return the topics on which the vehicle has published, by a query at this moment."""
        topics: set[str] = set()
        fetch_last(self.session, self.node, lambda topic, *_: topics.add(topic))
        return topics

    def wait_for_vehicle(self, seconds: float) -> bool:
        """Wait for the first sample; return whether it came within `seconds`."""
        return self._first_sample.wait(seconds)

    def get(self, topic: str, within_s: float = 1.0) -> Any:
        """Return the newest message of a topic. Raises NetworkError if none came or it is older than `within_s`."""
        stamped = self.latest.get(topic)
        if stamped is None:
            raise NetworkError(f"{self.node} at {self.endpoint} has sent no {topic}")
        if stamped.age_s > within_s:
            raise NetworkError(f"{self.node} at {self.endpoint} is lost: no {topic} for {stamped.age_s:.1f} s")
        return stamped.value

    def diagnostics(self) -> Diagnostics:
        """Return the slave's newest diagnostics; empty before the first."""
        stamped = self.latest.get("diagnostics")
        return stamped.value if stamped else Diagnostics()

    @property
    def has_samples(self) -> bool:
        """True once a sensor sample has been received."""
        return self._first_sample.is_set()

    def first_sample_ns(self, exec_wall_ns: int) -> int | None:
        """Return when (ns since 1970, our clock) the first sample of a slave started at `exec_wall_ns` was received.

        Return None if none was. Samples from before a restart of the slave do not count.
        """
        firsts = list(self._first_samples.values())
        return min([first.received_wall_ns for first in firsts if first.sent_wall_ns >= exec_wall_ns], default=None)

    def run_events(self, began_ns: int) -> tuple[RunEvent, ...]:
        """Return the events since `began_ns` (monotonic) that the vehicle has reported; their times count from it."""
        stamped = self.latest.get("diagnostics")
        if stamped is None:
            return ()
        events = stamped.value.run_event_list or ()
        ours = [e._replace(start_ns=self.contact.sent_ns(e.start_ns, stamped.received_ns)) for e in events]
        return events_since(ours, began_ns)

    @property
    def in_doubt(self) -> bool:
        """True if the vehicle has named another master, which may have left since; the next diagnostics will show."""
        return not self._rank and (self._named_before or 0 < self._named_other < HOLDS_ON)

    def unavailable_reason(self) -> str:
        """Return why the vehicle executes no commands, or not ours, with the remedy; "" if no reason is known."""
        values = self.diagnostics()
        if values.controller == "external" and (missing := self._missing_software()):
            return (
                f'{self.node} is left to software of its own (controller = "external" in its scenario), and none '
                f'{missing}: start that first, or let the slave have controller = "builtin"'
            )
        if values.armed is False:
            return f"{self.node} is disarmed: uuv-hil topic call /{self.node}/arm '{{data: true}}'"
        return self.refusal()

    def require_acceptance(
        self, reason: Callable[[], str] | None = None, pause: Callable[[float], object] = time.sleep
    ) -> None:
        """Wait until the vehicle's diagnostics give no `reason` to refuse this client's commands.

        `reason` returns a text, by default `unavailable_reason`. Raises NetworkError with this text if it lasts for
        3 s, because another master may have just left; at once if this client has commanded before. `pause` sleeps for
        the given seconds; it may raise, which ends the wait.
        """
        reason = reason or self.unavailable_reason
        deadline = now_ns() + (0 if self.has_commanded else REFUSED_NS)
        while (reason() or self.in_doubt or not self.diagnostics()) and now_ns() < deadline:
            pause(POLL_S)
        if text := reason():
            raise NetworkError(text)

    def _missing_software(self) -> str:
        """Return why the vehicle's external control software seems to be missing; "" if it may be present.

        A subscriber to cmd_vel may be only a recorder. Thrusters that move while we command are the proof.
        """
        if not self._commands.check_subscribers():
            return "listens to cmd_vel"
        undriven = self.diagnostics().thrusters_driven is False and self.has_commanded
        if undriven and now_ns() - self._undriven_ns > SOFTWARE_WITHIN_NS:
            return f"has driven its thrusters for {SOFTWARE_WITHIN_NS / NS_PER_S:.0f} s of commands"
        return ""

    def refusal(self) -> str:
        """Return why the vehicle executes others' commands but not ours, with the remedy; "" if unknown."""
        if self.contact.rivals:
            return (
                f"{self.contact.rivals} are all called {self.node}, and all would execute commands: end one of them, "
                "or give it another node in [slave]"
            )
        values = self.diagnostics()
        may_command = values.may_command
        if self._certificate and may_command and self._certificate not in may_command:
            return (
                f"{self.node} accepts commands of {', '.join(may_command)} only, and the certificate of this machine "
                f"names {self._certificate!r}: add it to may_command in the [security] section of the slave's scenario"
            )
        if self._named_other >= HOLDS_ON and (self.has_commanded or not self._rank):
            return (
                f"{self.node} is commanded by another master, {values.commander or 'an anonymous sender'}; end that "
                "one first, or take over with --take-over (in Python take_over=True)"
            )
        return ""

    def _deliver_unless_all(self, topic: str, payload: bytes, attachment: bytes) -> None:
        if ALL not in self._watched:  # the subscription to all topics delivers the message too
            self._deliver(topic, payload, attachment)

    def _deliver(self, topic: str, payload: bytes, attachment: bytes) -> None:
        received_ns = now_ns()
        decode = ros.decoder(topic)
        if decode is None:  # from a user's own sensor that is not known here
            return
        value = decode(payload)
        stamp = ros.unpack_attachment(attachment)
        if value is None or stamp is None:
            self.malformed += 1
            return
        self.received[topic] = self.received.get(topic, 0) + 1
        self.contact.samples += topic not in URGENT
        if self._senders.get(topic, stamp.gid) != stamp.gid:  # the vehicle restarted: its clock offset may differ
            self._senders.clear()
            self.contact.forget_clock()
        self._senders[topic] = stamp.gid
        if topic == "trace":
            self.delays.add(value, stamp.time_ns, to_wall_ns(received_ns))
            return
        if topic == "diagnostics":
            value = Diagnostics(value[0][3] if value else {})
            self._check_commander(value)
            if value.thrusters_driven is not False:
                self._undriven_ns = received_ns
        stamped = self.latest[topic] = Stamped(value, received_ns, self.contact.sent_ns(stamp.time_ns, received_ns))
        self._on_sample(topic, stamped)
        if topic != "diagnostics":
            first = self._first_samples.get(topic)
            if first is None or first.gid != stamp.gid:
                self._first_samples[topic] = _FirstSample(stamp.gid, stamp.time_ns, to_wall_ns(received_ns))
                self._first_sample.set()

    def _is_watched(self, topic: str) -> bool:
        return topic in self._watched or (ALL in self._watched and not is_picture(topic))

    def _check_commander(self, diagnostics: Diagnostics) -> None:
        self.contact.same_clock = diagnostics.boot_id == boot_id()
        other = (diagnostics.commanded_by or "") not in ("", self._commands.gid.hex())
        self._named_other = self._named_other + 1 if other else 0
        self._named_before = False

    def _fetch_last(self) -> None:
        """Fetch the last messages of a vehicle that has just appeared, so that slow topics are there at once."""
        self.contact.known.wait(CLOCK_WAIT_S)
        fetch_last(self.session, self.node, self._deliver_last)

    def _deliver_last(self, topic: str, payload: bytes, attachment: bytes) -> None:
        if topic not in self.latest and topic != "trace" and self._is_watched(topic):
            self._deliver(topic, payload, attachment)
            if topic == "diagnostics" and self._named_other:
                self._named_other, self._named_before = 0, True
