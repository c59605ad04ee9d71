"""Watch a run for events: contacts, capsizing, depth, loss of the thruster link."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from hil.slave.pilot import Pilot
from sim.run_events import PERIOD_NS, RunMonitor, place_text
from sim.simulation import Simulation

if TYPE_CHECKING:
    from hil.slave.drivers.driver import ThrusterDriver


class RunWatch:
    """Check a vehicle for events every PERIOD_NS of its time, from the loop; the simulation records contacts.

    What it finds is in the `events` of the simulation, and `report` gets a line when one begins. A depth is judged by
    what was asked of the vehicle itself: of one that is moved by velocities, as by `uuv-hil master`, the master knows.
    """

    def __init__(
        self, simulation: Simulation, driver: "ThrusterDriver", pilot: Pilot | None, report: Callable[[str], None]
    ) -> None:
        self._simulation, self._driver, self._pilot, self._report = simulation, driver, pilot, report
        self._monitor: RunMonitor | None = None  # from the first look on
        self._losses = 0
        self.due_ns = 0  # of simulation time

    def check(self) -> None:
        """Judge the present state."""
        simulation, driver = self._simulation, self._driver
        vehicle = simulation.vehicle
        monitor = self._monitor or RunMonitor(simulation.events, vehicle.capsize_tilt, 0.5 * vehicle.dimensions[2])
        self._monitor = monitor
        now, state = simulation.time_ns, simulation.state
        self.due_ns = now + PERIOD_NS
        position = state.position
        monitor.observe(now, position, state.quaternion, self._pilot.requested_depth if self._pilot else None)
        if driver.lost or driver.losses != self._losses:  # it may have come back since the last look
            self._losses = driver.losses
            monitor.log.hold("link_lost", now, now, position, "the thruster link")
        elif driver.is_silent:
            monitor.log.hold("link_lost", now, now, position, "the STM32 does not answer")
        for event in monitor.log.fresh():
            self._report(f"{event.name}, at {place_text(event.place)}")
