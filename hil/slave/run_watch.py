"""Detect events of a run: contacts, capsizing, depth violations, loss of the thruster link."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from hil.common.clock import now_ns, to_wall_ns
from hil.slave.command_source import CommandSource
from sim.run_events import PERIOD_NS, RunMonitor, position_text
from sim.simulation import Simulation

if TYPE_CHECKING:
    from hil.ros.diagnostics import Diagnostics
    from hil.slave.drivers.driver import ThrusterDriver


class RunWatch:
    """Check a vehicle for events every PERIOD_NS of simulation time, in the loop. Contacts are recorded elsewhere.

    Events are stored in the simulation's `events`; `report` gets a line when one begins. The depth is compared with
    depth commands to the vehicle only: a vehicle that is driven by velocities, as by `uuv-hil master`, has none.
    """

    def __init__(
        self, simulation: Simulation, driver: "ThrusterDriver", source: CommandSource, report: Callable[[str], None]
    ) -> None:
        self._simulation, self._driver, self._source, self._report = simulation, driver, source, report
        self._monitor: RunMonitor | None = None  # made by the first check
        self._losses = 0
        self.due_ns = 0  # simulation time

    def check(self) -> None:
        """Check the present state."""
        simulation, driver = self._simulation, self._driver
        vehicle = simulation.vehicle
        monitor = self._monitor or RunMonitor(simulation.events, vehicle.capsize_tilt, 0.5 * vehicle.dimensions[2])
        self._monitor = monitor
        now, state = simulation.time_ns, simulation.state
        self.due_ns = now + PERIOD_NS
        position = state.position
        monitor.observe(now, position, state.quaternion, self._source.requested_depth)
        if driver.lost or driver.losses != self._losses:  # also if it was lost and came back since the last check
            self._losses = driver.losses
            monitor.log.record("link_lost", now, now, position, "the thruster link")
        elif driver.is_silent:
            monitor.log.record("link_lost", now, now, position, "the STM32 does not answer")
        for event in monitor.log.new_events():
            self._report(f"{event.name}, at {position_text(event.position)}")

    def add_figures(self, figures: "Diagnostics") -> None:
        """Add the events of the run so far, with wall times."""
        log = self._simulation.events
        epoch_ns = to_wall_ns(now_ns()) - self._simulation.time_ns
        figures.contacts = self._simulation.contacts
        figures.run_events = len(log) + log.dropped
        figures.run_event_list = tuple([event._replace(start_ns=event.start_ns + epoch_ns) for event in log.events()])
