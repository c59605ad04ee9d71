"""Observe a hunt whose vehicles and planners are processes of their own.

Slaves with emulated STM32s, an agent for each, and here an observer of the truth, which none of them has; where
the vehicles have modems, it is also the water between these.
"""

import select
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from hil.bench.processes import cpu_s
from hil.cases.crew import Crew
from hil.cases.energy import EnergyMeter
from hil.cases.hunt.watch import HuntRow, HuntWatch
from hil.client.delay import DelayMeter
from hil.common.clock import NS_PER_S, RateKeeper, from_wall_ns, now_ns, seconds_ns, to_wall_ns
from hil.common.errors import NetworkError
from hil.common.stop import StopSignals
from hil.network.roles import open_master_session
from hil.network.session import Session
from hil.network.stall import mend_while_nobody
from hil.ros import encoders as ros
from hil.ros.diagnostics import Diagnostics, or_nan
from hil.scenario.config import Scenario
from hil.scenario.fleet import endpoints_of
from sim.run_events import RunEvent
from sim.vehicle.vehicle import load_vehicle

if TYPE_CHECKING:
    from hil.master.acoustic_channel import ModemNetwork

READY_S = 30.0  # until every vehicle has been seen and every agent reported
LOST_AFTER_S = 5.0  # without a word from one of them
FINAL_FIGURES_S = 3.0  # that the vehicles' figures of the time after the hunt are waited for
QUEUE = 64
_WATCHED = ("ground_truth", "formation", "diagnostics", "trace")


class Costs(NamedTuple):
    """Costs of a hunt: energy of all thrusters (J), shares of a core of all agents and of all slaves.

    `delays_ns` of commands, from an agent's publishing to applied pulses; `real_time` the slowest slave's factor;
    `messages` how many were sent by modem, delivered, and lost for which reason.
    """

    energy: float
    agents_cpu: float
    slaves_cpu: float
    delays_ns: list[int]
    real_time: float
    messages: Mapping[str, int]


def fly(scenario: Scenario, folder: str, watch: HuntWatch) -> Costs:
    """Hunt once, in real time, until `watch` ends it. The processes' logs go into `folder`.

    Raises KeyboardInterrupt when stopped, NetworkError when a process ends or falls silent.
    """
    slaves = {f"slave_{m.node}": ["slave", scenario.path, "--member", m.node] for m in scenario.member}
    agents = {f"agent_{m.node}": ["agent", scenario.path, "--member", m.node] for m in scenario.member}
    with (
        StopSignals() as stop_fd,
        Crew(slaves, folder) as vehicles,
        Crew(agents, folder) as planners,
        open_master_session(*endpoints_of(scenario), network=scenario.network) as session,
    ):
        return _Observer(scenario, session, vehicles, planners, watch).follow(stop_fd)


class _Seen:
    """The newest of each watched topic of one vehicle, and all its traces."""

    def __init__(self, session: Session, node: str) -> None:
        self.node = node
        self.latest: dict[str, Any] = {}
        self.received_ns = dict.fromkeys(_WATCHED, 0)
        self.delays = DelayMeter()
        for topic in _WATCHED:
            session.subscribe(node, topic, self._on_message, QUEUE)

    def _on_message(self, topic: str, payload: bytes, attachment: bytes) -> None:
        decode = ros.decoder(topic)
        value = decode(payload) if decode else None
        stamp = ros.unpack_attachment(attachment)
        if value is None or stamp is None:
            return
        self.received_ns[topic] = now_ns()
        if topic == "trace":
            self.delays.add(value, stamp.time_ns, to_wall_ns(now_ns()))
        else:
            self.latest[topic] = value

    @property
    def complete(self) -> bool:
        """True once a message of every topic that a row needs has come."""
        return all(topic in self.latest for topic in ("ground_truth", "formation", "diagnostics"))

    @property
    def health(self) -> Diagnostics:
        """The slave's figures."""
        statuses = self.latest["diagnostics"]
        return Diagnostics(statuses[0][3] if statuses else {})

    def age_s(self, topic: str) -> float:
        """Return time (s) since the last message."""
        return (now_ns() - self.received_ns[topic]) / NS_PER_S


class _Observer:
    """Recorder of one row of each vehicle's newest samples, as often as commands are sent."""

    def __init__(self, scenario: Scenario, session: Session, slaves: Crew, agents: Crew, watch: HuntWatch) -> None:
        self._slaves, self._agents, self._watch = slaves, agents, watch
        self._seen = [_Seen(session, member.node) for member in scenario.member]
        self._period_ns = seconds_ns(scenario.master.command_period)
        vehicle, _ = load_vehicle(scenario.vehicle)
        self._meters = [EnergyMeter(vehicle) for _ in scenario.member]
        self._modems = _open_modems(session, scenario)
        mend_while_nobody(session, self._is_complete, scenario.network.lease)
        self._started_ns = now_ns()

    def follow(self, stop_fd: int) -> Costs:
        """Follow the hunt to its end."""
        self._until_complete(stop_fd)
        before = self._cpu()
        began = now_ns()
        schedule = RateKeeper(self._period_ns, began)
        while not self._watch.reason:
            _pause(stop_fd, schedule.deadline_ns)
            if schedule.due(now_ns()):
                self._add_row((now_ns() - began) / NS_PER_S)
        duration = (now_ns() - began) / NS_PER_S
        self._add_events(began, stop_fd)
        agents, slaves = ((now - then) / duration for now, then in zip(self._cpu(), before, strict=True))
        return Costs(
            sum(meter.joules for meter in self._meters),
            agents,
            slaves,
            [delay for seen in self._seen for delay in seen.delays.totals_ns()],
            min(or_nan(seen.health.real_time_factor) for seen in self._seen),
            self._modems.counts if self._modems else {},
        )

    def _add_events(self, began: int, stop_fd: int) -> None:
        """Add the events that the vehicles report, once the report of each reaches until now."""
        ended, deadline = now_ns(), now_ns() + seconds_ns(FINAL_FIGURES_S)
        while now_ns() < deadline and any(seen.received_ns["diagnostics"] < ended for seen in self._seen):
            _pause(stop_fd, now_ns() + self._period_ns)
        for number, seen in enumerate(self._seen):
            events = seen.health.run_event_list or ()
            mine = [event._replace(start_ns=from_wall_ns(event.start_ns)) for event in events]
            here = [event for event in mine if event.end_ns >= self._started_ns and event.start_ns <= ended]
            self._watch.add_events(number, [_from(event, began) for event in here])

    def _until_complete(self, stop_fd: int) -> None:
        deadline = now_ns() + seconds_ns(READY_S)
        while not self._is_complete():
            _pause(stop_fd, now_ns() + self._period_ns)
            self._check()
            if now_ns() > deadline:
                missing = ", ".join(seen.node for seen in self._seen if not seen.complete)
                raise NetworkError(f"nothing of {missing} within {READY_S:.0f} s; see the logs of slaves and agents")

    def _is_complete(self) -> bool:
        return all(seen.complete for seen in self._seen)

    def _add_row(self, time: float) -> None:
        self._check()
        for seen in self._seen:
            for topic in ("ground_truth", "formation"):
                if seen.age_s(topic) > LOST_AFTER_S:
                    raise NetworkError(f"{seen.node} says no {topic} any more; see the logs of its slave and agent")
        for number, seen in enumerate(self._seen):
            self._watch.observe(number, time, seen.latest["ground_truth"])
        positions = tuple([seen.latest["ground_truth"].position[:2] for seen in self._seen])
        clocks = tuple([seen.latest["formation"].clock_ns / NS_PER_S for seen in self._seen])
        self._watch.add_row(HuntRow(time, positions, clocks))
        for seen, meter in zip(self._seen, self._meters, strict=True):
            meter.add(time, seen.health.pwm_us or ())

    def _check(self) -> None:
        self._slaves.check()
        self._agents.check()

    def _cpu(self) -> tuple[float, float]:
        """Return the processor time (s) of all agents, and of all slaves."""
        return cpu_s(self._agents.pids), cpu_s(self._slaves.pids)


def _from(event: RunEvent, began_ns: int) -> RunEvent:
    """Return `event` with times from `began_ns` on; earlier ones begin at 0."""
    start, end = (max(instant - began_ns, 0) for instant in (event.start_ns, event.end_ns))
    return event._replace(start_ns=start, duration_ns=end - start)


def _open_modems(session: Session, scenario: Scenario) -> "ModemNetwork | None":
    """Return what is between modems; None where there are none."""
    if not scenario.modem:
        return None
    from hil.master.acoustic_channel import ModemNetwork  # most fleets talk over the network

    return ModemNetwork(session, scenario)


def _pause(stop_fd: int, until_ns: int) -> None:
    """Wait until then. Raises KeyboardInterrupt when a stop is requested."""
    if select.select((stop_fd,), (), (), max(until_ns - now_ns(), 0) / NS_PER_S)[0]:
        raise KeyboardInterrupt
