"""Fly a hunt with separate processes, and observe it.

There is a slave with an emulated STM32 and an agent for each vehicle. This process observes the true states, which the
agents do not receive. If the vehicles have modems, it also simulates the acoustic channel between them.
"""

from collections.abc import Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING

from hil.bench.processes import cpu_s
from hil.cases.energy import EnergyMeter
from hil.cases.hunt.watch import HuntRow, HuntWatch, modem_figures
from hil.cases.process_group import ProcessGroup
from hil.client.client import VehicleClient
from hil.client.delay import quantiles
from hil.common.clock import NS_PER_S, RateKeeper, now_ns, seconds_ns
from hil.common.errors import NetworkError
from hil.common.stop import StopSignals, pause
from hil.network.roles import open_master_session
from hil.network.session import Session
from hil.ros.diagnostics import or_nan
from hil.scenario.config import Scenario
from hil.scenario.fleet import endpoints_of
from sim.run_events import RunEvent
from sim.vehicle.vehicle import load_vehicle

if TYPE_CHECKING:
    from hil.master.acoustic_channel import ModemNetwork

READY_S = 30.0  # until every vehicle and every agent has sent its first messages
LOST_AFTER_S = 5.0  # without messages of a vehicle or an agent
FINAL_DIAGNOSTICS_S = 3.0  # greatest wait for diagnostics from after the end of the hunt
_TOPICS = ("ground_truth", "formation")  # of a row


def fly(scenario: Scenario, folder: str, watch: HuntWatch) -> dict[str, float]:
    """Fly once, in real time, until `watch` ends the hunt; return what it cost.

    The costs are fields of a case's `Result`, of all vehicles together, and others by their heading. The logs of the
    processes go to `folder`.

    Raises KeyboardInterrupt on a stop signal, NetworkError if a process ends or stops sending.
    """
    slaves = {f"slave_{m.node}": ["slave", scenario.path, "--member", m.node] for m in scenario.member}
    agents = {f"agent_{m.node}": ["fleet", "agent", scenario.path, "--member", m.node] for m in scenario.member}
    with (
        StopSignals() as stop_fd,
        ProcessGroup(slaves, folder) as vehicles,
        ProcessGroup(agents, folder) as planners,
        open_master_session(*endpoints_of(scenario), network=scenario.network) as session,
        ExitStack() as stack,
    ):
        opened = [VehicleClient(session, m.node, role="observer", topics=_TOPICS) for m in scenario.member]
        clients = [stack.enter_context(client) for client in opened]
        return _Observer(scenario, session, clients, vehicles, planners, watch).follow(stop_fd)


class _Observer:
    """Recorder of rows with each vehicle's newest samples, at the rate of commands."""

    def __init__(
        self,
        scenario: Scenario,
        session: Session,
        clients: Sequence[VehicleClient],
        slaves: ProcessGroup,
        agents: ProcessGroup,
        watch: HuntWatch,
    ) -> None:
        self._clients, self._slaves, self._agents, self._watch = clients, slaves, agents, watch
        for client in clients:
            client.delays.store()
        self._period_ns = seconds_ns(scenario.master.command_period)
        vehicle, _ = load_vehicle(scenario.vehicle)
        self._meters = [EnergyMeter(vehicle) for _ in scenario.member]
        self._modems = _open_modems(session, scenario)
        session.supervisor.watch_presence(self._is_complete)
        self._started_ns = now_ns()

    def follow(self, stop_fd: int) -> dict[str, float]:
        """Record the hunt until its end; return its costs."""
        self._wait_until_complete(stop_fd)
        before = self._cpu()
        began = now_ns()
        schedule = RateKeeper(self._period_ns, began)
        while not self._watch.reason:
            pause(stop_fd, max(schedule.deadline_ns - now_ns(), 0) / NS_PER_S)
            if schedule.due(now_ns()):
                self._add_row((now_ns() - began) / NS_PER_S)
        duration = (now_ns() - began) / NS_PER_S
        self._add_events(began, stop_fd)
        agents, slaves = ((now - then) / duration for now, then in zip(self._cpu(), before, strict=True))
        delays = [delay for client in self._clients for delay in client.delays.totals_ns()]
        return {
            "energy": sum(meter.joules for meter in self._meters),
            "master_cpu": agents,
            "delay_p50": quantiles(delays).p50_ms,
            "delay_p99": quantiles(delays).p99_ms,
            "commands measured": len(delays),
            "slowest slave (of real time)": min(or_nan(each.diagnostics().real_time_factor) for each in self._clients),
            "CPU of an agent (of a core)": agents / len(self._clients),
            "CPU of a slave (of a core)": slaves / len(self._clients),
            **modem_figures(self._modems.counts if self._modems else {}),
        }

    def _add_events(self, began: int, stop_fd: int) -> None:
        """Add the events that the vehicles report; first wait for diagnostics from after the end of the hunt."""
        ended, deadline = now_ns(), now_ns() + seconds_ns(FINAL_DIAGNOSTICS_S)
        while now_ns() < deadline and any(c.latest["diagnostics"].received_ns < ended for c in self._clients):
            pause(stop_fd, self._period_ns / NS_PER_S)
        for number, client in enumerate(self._clients):
            own = [e for e in client.run_events(self._started_ns) if e.start_ns <= ended - self._started_ns]
            self._watch.add_events(number, [_relative_to(event, began - self._started_ns) for event in own])

    def _wait_until_complete(self, stop_fd: int) -> None:
        deadline = now_ns() + seconds_ns(READY_S)
        while not self._is_complete():
            pause(stop_fd, self._period_ns / NS_PER_S)
            self._check()
            if now_ns() > deadline:
                missing = ", ".join(client.node for client in self._clients if not _is_complete(client))
                raise NetworkError(
                    f"no messages of {missing} within {READY_S:.0f} s; read the logs of slaves and agents"
                )

    def _is_complete(self) -> bool:
        return all(map(_is_complete, self._clients))

    def _add_row(self, time: float) -> None:
        self._check()
        for client in self._clients:
            for topic in _TOPICS:
                if now_ns() - client.latest[topic].received_ns > LOST_AFTER_S * NS_PER_S:
                    raise NetworkError(f"{client.node} stopped sending {topic}; read the logs of its slave and agent")
        truths = [client.latest["ground_truth"].value for client in self._clients]
        for number, truth in enumerate(truths):
            self._watch.observe(number, time, truth)
        positions = tuple([truth.position[:2] for truth in truths])
        clocks = tuple([client.latest["formation"].value.clock_ns / NS_PER_S for client in self._clients])
        self._watch.add_row(HuntRow(time, positions, clocks))
        for client, meter in zip(self._clients, self._meters, strict=True):
            meter.add(time, client.diagnostics().pwm_us or ())

    def _check(self) -> None:
        self._slaves.check()
        self._agents.check()

    def _cpu(self) -> tuple[float, float]:
        """Return the processor time (s) of all agents, and of all slaves."""
        return cpu_s(self._agents.pids), cpu_s(self._slaves.pids)


def _is_complete(client: VehicleClient) -> bool:
    """Return whether a message of every topic for a row has been received."""
    return all(topic in client.latest for topic in (*_TOPICS, "diagnostics"))


def _relative_to(event: RunEvent, began_ns: int) -> RunEvent:
    """Return `event` with times since `began_ns`; the part before is cut off."""
    start, end = (max(instant - began_ns, 0) for instant in (event.start_ns, event.end_ns))
    return event._replace(start_ns=start, duration_ns=end - start)


def _open_modems(session: Session, scenario: Scenario) -> "ModemNetwork | None":
    """Return the simulated channel between the modems, None without modems."""
    if not scenario.modem:
        return None
    from hil.master.acoustic_channel import ModemNetwork  # only needed for fleets with modems

    return ModemNetwork(session, scenario)
