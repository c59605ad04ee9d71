"""Run the planner of one vehicle of a fleet: command the vehicle, exchange reports with its neighbours.

There is no central process. An agent knows of the other vehicles what their planners publish on the topic `formation`.
In a scenario with modems it receives the reports by modem, and `formation` is only for displays.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from hil.autonomy.control.controller import VelocityCommand
from hil.client.client import VehicleClient
from hil.common.clock import NS_PER_S, RateKeeper, now_ns, seconds_ns, to_wall_ns
from hil.common.errors import ConfigError, MissionError, NetworkError
from hil.common.stop import is_stopped
from hil.master.flight import held
from hil.master.hunt import HuntPlanner
from hil.network.publisher import Publisher
from hil.network.roles import open_peer_session
from hil.network.session import Session
from hil.ros.graph import Node
from hil.ros.topics import TOPICS
from hil.scenario.config import Scenario
from hil.scenario.fleet import hunting_of, member_number
from sim.run_events import EventLog, RunEvent, RunMonitor, merge_events, position_text
from sim.vehicle.vehicle import load_vehicle

if TYPE_CHECKING:
    from hil.master.modem_port import ModemPort

REPORTS = TOPICS["formation"]
QUEUE = 8  # reports of one neighbour that may wait to be processed
LOST_AFTER_S = 1.0
GIVE_UP_AFTER_S = 10.0
REPORT_PERIOD_S = 5.0

Report = Callable[[str], None]


def run(scenario: Scenario, which: str, stop_fd: int, report: Report, wait: float = 60.0) -> None:
    """Run the planner of the member `which` until `stop_fd` becomes readable.

    Waits up to `wait` s for the vehicle. Raises ConfigError, NetworkError, and MissionError if the vehicle had an event
    (sim/run_events.py) that the scenario does not allow.
    """
    if scenario.security and scenario.modem:
        raise ConfigError(
            f"{scenario.path}: the simulated acoustic channel of [modem] has no [security]: leave out one of the two"
        )
    number = member_number(scenario, which)
    me, others = scenario.member[number], scenario.member[:number]
    planner = HuntPlanner(scenario, number)
    network = scenario.network
    faults: list[RunEvent] = []
    endpoints = me.listen, *(other.agent for other in others)
    with open_peer_session(me.agent, *endpoints, network=network, security=scenario.security) as session:
        began = now_ns()
        modem = _modem(session, scenario, number, planner, began)
        reports = session.publisher(me.node, REPORTS)
        reports.gid = _subscribe_reports(session, scenario, me.node, planner, began)
        with VehicleClient(
            session,
            me.node,
            network=network,
            security=scenario.security,
            report=report,
            topics=("odom", *planner.subscriptions),
        ) as client:
            report(f"{me.node}: planning, reports at {me.agent}")
            if _wait(client, stop_fd, wait):
                agent = _Agent(scenario, planner, client, reports, began, report, modem)
                agent.run(stop_fd)
                faults = agent.report_events()
    report(f"reports: {planner.received} received, {planner.beyond} from out of range, {planner.malformed} malformed")
    if faults:
        raise MissionError(f"{me.node}: {faults[0].describe()}" + (f", and {len(faults) - 1} more" * (len(faults) > 1)))


def _subscribe_reports(session: Session, scenario: Scenario, own: str, planner: HuntPlanner, began: int) -> bytes:
    """Announce the topics to ROS and, in a fleet without modems, subscribe to the reports of all other members.

    Return the gid of its own reports.
    """
    graph = Node(session, f"{own}_agent")
    gid = graph.publishes(REPORTS, own)
    if scenario.modem:
        return gid

    def receive_from(node: str) -> Callable[[str, bytes, bytes], None]:
        return lambda _topic, payload, _attachment: planner.on_report(node, payload, (now_ns() - began) / NS_PER_S)

    for member in scenario.member:
        if member.node != own:
            graph.subscribes(REPORTS, member.node)
            session.subscribe(member.node, REPORTS.name, receive_from(member.node), QUEUE)
    return gid


def _modem(session: Session, scenario: Scenario, number: int, planner: HuntPlanner, began: int) -> "ModemPort | None":
    """Return the member's modem; None in a fleet without modems."""
    if not scenario.modem:
        return None
    from hil.master.modem_port import ModemPort  # a late import: most fleets have no modems

    return ModemPort(session, scenario, number, planner, began)


def _wait(client: VehicleClient, stop_fd: int, seconds: float) -> bool:
    """Wait up to `seconds` for odometry; return False if stopped. Raises NetworkError if none arrives."""
    deadline = now_ns() + seconds_ns(seconds)
    while "odom" not in client.latest:
        if is_stopped(stop_fd, 0.02):
            return False
        if now_ns() > deadline:
            raise NetworkError(
                f"no vehicle {client.node!r} answered at {client.endpoint} within {seconds:g} s; is "
                f"`uuv-hil slave SCENARIO --member {client.node}` running there?"
            )
    return True


class _Agent:
    """Send commands and reports, each at its own rate."""

    def __init__(
        self,
        scenario: Scenario,
        planner: HuntPlanner,
        client: VehicleClient,
        reports: Publisher,
        began: int,
        report: Report,
        modem: "ModemPort | None",
    ) -> None:
        self._modem = modem
        self._planner = planner
        self._client = client
        self._reports = reports
        self._began = began
        self._report = report
        now = now_ns()
        self._commands_due = RateKeeper(seconds_ns(scenario.master.command_period), now)
        self._reports_due = RateKeeper(seconds_ns(hunting_of(scenario).report_period), now)
        self._progress_due = RateKeeper(seconds_ns(REPORT_PERIOD_S), now)
        self._is_silent = False
        vehicle, _ = load_vehicle(scenario.vehicle)
        self._allow = scenario.master.allow
        self._position: Sequence[float] = (0.0, 0.0, 0.0)
        self._monitor = RunMonitor(
            EventLog(), vehicle.capsize_tilt, 0.5 * vehicle.dimensions[2], scenario.master.depth_margin
        )

    def report_events(self) -> list[RunEvent]:
        """Report the events of the vehicle, and return those that the scenario does not allow."""
        events = merge_events(self._client.run_events(self._began), self._monitor.log.events())
        for event in events:
            self._report(f"{'expected' if event.kind in self._allow else 'EVENT'}: {event.describe()}")
        return [event for event in events if event.kind not in self._allow]

    def run(self, stop_fd: int) -> None:
        """Run until `stop_fd` becomes readable; then stop the vehicle."""
        while True:
            due = min(self._commands_due.deadline_ns, self._reports_due.deadline_ns)
            due = min(due, self._modem.deadline_ns) if self._modem else due
            if is_stopped(stop_fd, max(due - now_ns(), 0) / NS_PER_S):
                self._client.command(VelocityCommand())
                return
            now = now_ns()
            if self._commands_due.due(now):
                self._command((now - self._began) / NS_PER_S)
            if self._reports_due.due(now) and (report := self._planner.report()):
                self._reports.put(report, to_wall_ns(now))
            if self._modem:
                self._modem.send_report()

    def _command(self, time: float) -> None:
        odometry = self._client.latest["odom"]
        if self._is_lost(odometry.age_s):
            return
        refusal = self._client.unavailable_reason()
        if refusal:
            raise NetworkError(refusal)
        command = self._planner.command(time, {"odom": odometry.value})
        assert isinstance(command, VelocityCommand)
        seen = odometry.value
        self._position = seen.position
        self._monitor.observe(seconds_ns(time), seen.position, seen.orientation, command.depth)
        for event in self._monitor.log.new_events():
            self._report(f"{time:6.1f} s  {event.name}, at {position_text(event.position)}")
        self._client.command(held(command, odometry.value))
        if self._progress_due.due(now_ns()):
            self._report(f"{time:6.1f} s  {self._planner.progress:4.0%} of the plan, {self._planner.status}")

    def _is_lost(self, age_s: float) -> bool:
        """Return whether the vehicle's odometry, `age_s` old, is overdue. The plan's clock stops meanwhile.

        Raises NetworkError after GIVE_UP_AFTER_S.
        """
        if age_s > GIVE_UP_AFTER_S:
            raise NetworkError(f"{self._client.node} at {self._client.endpoint} has not answered for {age_s:.0f} s")
        if age_s > LOST_AFTER_S and not self._is_silent:
            self._report(f"no odometry from the vehicle for {age_s:.1f} s, waiting for it")
        self._is_silent = age_s > LOST_AFTER_S
        if self._is_silent:
            now = now_ns() - self._began
            what = f"no odometry from {self._client.node}"
            self._monitor.log.record("link_lost", max(now - seconds_ns(age_s), 0), now, self._position, what)
        return self._is_silent
