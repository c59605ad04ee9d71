"""The planner of one vehicle of a fleet as a process: it commands its own vehicle and talks with its neighbours'.

No other process leads it: what it knows of the others is what their planners say on the topic `formation`, or what
the modem of a scenario that has one lets through of it; `formation` is then for those who look on.
"""

import select
from collections.abc import Callable
from typing import TYPE_CHECKING

from hil.autonomy.control import VelocityCommand
from hil.clock import NS_PER_S, RateKeeper, now_ns, seconds_ns, to_wall_ns
from hil.config import Scenario
from hil.errors import ConfigError, NetworkError
from hil.fleet import hunting_of, member_number
from hil.master.client import VehicleClient
from hil.master.flight import held
from hil.master.hunt import HuntPlanner
from hil.topics import TOPICS
from hil.transport.graph import Node
from hil.transport.publisher import Publisher
from hil.transport.roles import meet
from hil.transport.session import Session

if TYPE_CHECKING:
    from hil.master.modem_voice import ModemVoice

REPORTS = TOPICS["formation"]
QUEUE = 8  # reports of one neighbour that may wait for the reader
GONE_AFTER_S = 1.0
GIVE_UP_AFTER_S = 10.0
NOTE_PERIOD_S = 5.0

Say = Callable[[str], None]


def run(scenario: Scenario, which: str, stop_fd: int, say: Say, wait: float = 60.0) -> None:
    """Be the planner of the member `which` until `stop_fd` becomes readable.

    Waits up to `wait` s for the vehicle. Raises ConfigError, MissionError, NetworkError.
    """
    if scenario.security:
        raise ConfigError(f"{scenario.path}: planners of a fleet have no [security] yet: leave it out")
    number = member_number(scenario, which)
    me, others = scenario.member[number], scenario.member[:number]
    planner = HuntPlanner(scenario, number)
    network = scenario.network
    with meet(me.agent, me.listen, *(other.agent for other in others), network=network) as session:
        began = now_ns()
        voice = _voice(session, scenario, number, planner, began)
        _listen(session, scenario, me.node, planner, began)
        with VehicleClient(session, me.node, network=network, report=say, topics=("odom", *planner.listens)) as client:
            say(f"{me.node}: planning, heard at {me.agent}")
            if _wait(client, stop_fd, wait):
                _Agent(scenario, planner, client, session.publisher(me.node, REPORTS), began, say, voice).lead(stop_fd)
    say(f"reports: {planner.heard} heard, {planner.beyond} from out of range, {planner.malformed} malformed")


def _listen(session: Session, scenario: Scenario, own: str, planner: HuntPlanner, began: int) -> None:
    """Let the planner hear all others, but for those with modems, and ROS see who says what to whom."""
    graph = Node(session, f"{own}_agent")
    graph.publishes(REPORTS, own)
    if scenario.modem:
        return

    def hears(node: str) -> Callable[[str, bytes, bytes], None]:
        return lambda _topic, payload, _attachment: planner.hear(node, payload, (now_ns() - began) / NS_PER_S)

    for member in scenario.member:
        if member.node != own:
            graph.subscribes(REPORTS, member.node)
            session.subscribe(member.node, REPORTS.name, hears(member.node), QUEUE)


def _voice(session: Session, scenario: Scenario, number: int, planner: HuntPlanner, began: int) -> "ModemVoice | None":
    """Its modem, None without one."""
    if not scenario.modem:
        return None
    from hil.master.modem_voice import ModemVoice  # most fleets talk over the network

    return ModemVoice(session, scenario, number, planner, began)


def _wait(client: VehicleClient, stop_fd: int, seconds: float) -> bool:
    """Until there is odometry; False when told to stop. Raises NetworkError when none comes."""
    deadline = now_ns() + seconds_ns(seconds)
    while "odom" not in client.latest:
        if select.select((stop_fd,), (), (), 0.02)[0]:
            return False
        if now_ns() > deadline:
            raise NetworkError(
                f"no vehicle {client.node!r} answered at {client.endpoint} within {seconds:g} s; is "
                f"`uuv-hil slave SCENARIO --member {client.node}` running there?"
            )
    return True


class _Agent:
    """Commands and reports, each at its own rate."""

    def __init__(
        self,
        scenario: Scenario,
        planner: HuntPlanner,
        client: VehicleClient,
        reports: Publisher,
        began: int,
        say: Say,
        voice: "ModemVoice | None",
    ) -> None:
        self._voice = voice
        self._planner = planner
        self._client = client
        self._reports = reports
        self._began = began
        self._say = say
        now = now_ns()
        self._commands_due = RateKeeper(seconds_ns(scenario.master.command_period), now)
        self._reports_due = RateKeeper(seconds_ns(hunting_of(scenario).report_period), now)
        self._notes_due = RateKeeper(seconds_ns(NOTE_PERIOD_S), now)
        self._silent = False

    def lead(self, stop_fd: int) -> None:
        """Until `stop_fd` becomes readable; then the vehicle is told to stand still."""
        while True:
            due = min(self._commands_due.deadline_ns, self._reports_due.deadline_ns)
            due = min(due, self._voice.deadline_ns) if self._voice else due
            if select.select((stop_fd,), (), (), max(due - now_ns(), 0) / NS_PER_S)[0]:
                self._client.command(VelocityCommand())
                return
            now = now_ns()
            if self._commands_due.due(now):
                self._command((now - self._began) / NS_PER_S)
            if self._reports_due.due(now) and (report := self._planner.report()):
                self._reports.put(report, to_wall_ns(now))
            if self._voice:
                self._voice.speak()

    def _command(self, time: float) -> None:
        odometry = self._client.latest["odom"]
        if self._is_gone(odometry.age_s):
            return
        refusal = self._client.refusal()
        if refusal:
            raise NetworkError(refusal)
        command = self._planner.command(time, {"odom": odometry.value})
        assert isinstance(command, VelocityCommand)
        self._client.command(held(command, odometry.value))
        if self._notes_due.due(now_ns()):
            self._say(f"{time:6.1f} s  {self._planner.progress:4.0%} of the plan, {self._planner.note}")

    def _is_gone(self, age_s: float) -> bool:
        """Whether the vehicle says nothing; then the plan's clock stands. Raises NetworkError if it stays away."""
        if age_s > GIVE_UP_AFTER_S:
            raise NetworkError(f"{self._client.node} at {self._client.endpoint} is gone for {age_s:.0f} s")
        if age_s > GONE_AFTER_S and not self._silent:
            self._say(f"no word from the vehicle for {age_s:.1f} s, waiting for it")
        self._silent = age_s > GONE_AFTER_S
        return self._silent
