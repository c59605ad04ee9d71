"""The real-time loop: handle commands as they arrive, step the physics on schedule, publish samples when due."""

import select
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol

from hil.common.clock import NS_PER_MS, NS_PER_S, NS_PER_US, RateKeeper, now_ns
from hil.slave.command_source import CommandSource
from hil.slave.drivers.driver import ThrusterDriver
from hil.slave.run_watch import RunWatch
from hil.slave.sample_publisher import SamplePublisher
from sim.simulation import Simulation

if TYPE_CHECKING:
    from hil.ros.diagnostics import Diagnostics
    from sim.vehicle.failures import Failure


class NodeServer(Protocol):
    """Serve the slave as a ROS 2 node in the loop's thread: hil.slave.ros.node.RosNode."""

    due_ns: int  # simulation time of the next `tick`

    def fileno(self) -> int:
        """Return the descriptor to wait on."""

    def serve(self) -> None:
        """Answer one service call."""

    def tick(self, time_ns: int) -> None:
        """Publish what is due at this simulation time."""


class Observer(Protocol):
    """What is called with all that a run depends on, each with its simulation time (ns), between two steps."""

    def record_step(self, time_ns: int, pulses: Sequence[int]) -> None:
        """Handle the pulse widths (us) of the step that begins now."""

    def record_state(self, time_ns: int, *pose: Sequence[float]) -> None:
        """Handle that the vehicle was moved: position, quaternion, nu."""

    def record_failures(self, time_ns: int, failures: "Sequence[Failure]") -> None:
        """Handle that thrusters failed or were repaired."""

    def record_epoch(self, time_ns: int, epoch_ns: int) -> None:
        """Handle that stamps count from another epoch (ns since 1970) after this time."""


class Loop:
    """Run one vehicle. The parts are passed in; nothing is opened or closed here.

    While `paused` is true the simulation is not stepped. `ros` is set after the vehicle is ready. `observers` may be
    added before the first step.
    """

    def __init__(
        self,
        simulation: Simulation,
        driver: ThrusterDriver,
        source: CommandSource,
        sample_publisher: SamplePublisher,
        step_ns: int,
        report: Callable[[str], None],
    ) -> None:
        self.simulation = simulation
        self.driver = driver
        self.source = source
        self.sample_publisher = sample_publisher
        self.paused = False
        self.ros: NodeServer | None = None
        self.observers: list[Observer] = []
        self.pwm_us = driver.pwm_us  # the same tuple object as long as it is unchanged, which a step detects quickly
        self._link_due_ns = 0  # when the driver has to be serviced even if no byte has arrived
        self._link_fds = driver.descriptors
        self.schedule = RateKeeper(step_ns, now_ns())
        self._stamped = -1  # value of `schedule.skipped` when the present epoch of the stamps began
        self.watch = RunWatch(simulation, driver, source, report)
        self.started_ns = now_ns()

    def run(self, stop_fd: int) -> None:
        """Run until `stop_fd` becomes readable."""
        source, ros = self.source, self.ros
        source_fd, ros_fd = source.fileno(), ros.fileno() if ros else -1
        own_fds = [fd for fd in (stop_fd, source_fd, ros_fd) if fd >= 0]
        link_fds: list[int] | None = None
        self.started_ns = now_ns()
        schedule = self.schedule = RateKeeper(self.schedule.period_ns, self.started_ns)
        while True:
            if link_fds is not self._link_fds:  # at first, and when the link was lost or is back
                link_fds, of_link = self._link_fds, frozenset(self._link_fds)
                fds = own_fds + link_fds
            ready = select.select(fds, (), (), schedule.timeout())[0]
            now = now_ns() if ready else schedule.on_wakeup()
            if stop_fd in ready:
                break
            if now >= source.due_ns or source_fd in ready:
                self.serve_source(now)
            if now >= self._link_due_ns or not of_link.isdisjoint(ready):
                self.service_link(now_ns())
            if now >= schedule.deadline_ns:
                self.advance_to(now)
            if ros and ros_fd in ready:
                ros.serve()  # after the step, when there is time until the next one
        source.finish()
        self.sample_publisher.wake_publisher()

    def begin(self) -> None:
        """Do one step that ends now, before the schedule begins."""
        self._stamp_from(now_ns() - self.schedule.period_ns)
        self.advance(1)

    def advance_to(self, now: int) -> None:
        """Advance by the steps that are due by `now`. Stamps give the time a step was due, not when it was computed."""
        schedule, stamps = self.schedule, self.sample_publisher.stamps
        steps = schedule.due(now)
        if self.paused:
            self._stamped = -1  # a new epoch begins when the pause ends
            self.sample_publisher.wake_publisher()
            return
        if schedule.skipped != self._stamped or stamps.found_ns != stamps.offset_ns:
            self._stamped, stamps.offset_ns = schedule.skipped, stamps.found_ns
            self._stamp_from(schedule.deadline_ns - (steps + 1) * schedule.period_ns)
        self.advance(self.source.permitted_steps(steps))

    def _stamp_from(self, instant_ns: int) -> None:
        """Set the stamps so that the next step begins at this monotonic time (ns)."""
        self.stamp(instant_ns + self.sample_publisher.stamps.offset_ns - self.simulation.time_ns)

    def stamp(self, epoch_ns: int) -> None:
        """Let simulation time 0 be this time (ns since 1970) from the next step on; see `hil.recording.stamps`."""
        self.sample_publisher.stamps.begin(self.simulation.time_ns, epoch_ns)
        for observer in self.observers:
            observer.record_epoch(self.simulation.time_ns, epoch_ns)

    def advance(self, steps: int) -> None:
        """Advance the simulation by this number of steps, and publish the sensor samples of each."""
        simulation, source = self.simulation, self.source
        for _ in range(steps):
            has_sent = False
            for observer in self.observers:
                observer.record_step(simulation.time_ns, self.pwm_us)
            for topic, sample in simulation.step(self.pwm_us):
                source.update_sensor(topic, sample)
                has_sent |= self.sample_publisher.publish_sample(topic, sample)
            source.end_step(simulation, has_sent)
        if simulation.time_ns >= self.watch.due_ns:
            self.watch.check()
        ros = self.ros
        if ros and simulation.time_ns >= ros.due_ns:
            ros.tick(simulation.time_ns)
        self.sample_publisher.wake_publisher()

    def set_state(self, position: Sequence[float], quaternion: Sequence[float], nu: Sequence[float]) -> None:
        """Set the vehicle's state (position NED, quaternion body to NED, nu FRD) between steps; thrusters neutral."""
        self.simulation.place(position, quaternion, nu)
        self.source.set_neutral()
        for observer in self.observers:
            observer.record_state(self.simulation.time_ns, position, quaternion, nu)

    def fail(self, *failures: "Failure") -> None:
        """Set or clear thruster failures from the next step on. Raises ConfigError for an unknown thruster."""
        self.simulation.fail(*failures)
        for observer in self.observers:
            observer.record_failures(self.simulation.time_ns, failures)

    def serve_source(self, now: int) -> None:
        """Let the command source send what is due; if it keeps the step, do a step that waited for it."""
        if not self.source.serve(now):
            return
        self._follow_driver()
        if self.source.keeps_step:
            self.service_link(now_ns())  # so that a step that follows at once uses the new pulse widths
            self.advance(self.source.permitted_steps(0))

    def service_link(self, now: int) -> None:
        """Do what is due on the thruster link at `now` (monotonic ns)."""
        received = self.driver.service(now)
        now = now_ns() if received else now  # the read took time, which counts into the delay
        self._follow_driver()
        self.source.handle_telemetry(received, now)

    def _follow_driver(self) -> None:
        """Copy what the driver changes when it sends or is serviced."""
        driver = self.driver
        self._link_due_ns, self._link_fds, self.pwm_us = driver.deadline_ns, driver.descriptors, driver.pwm_us

    def add_figures(self, figures: "Diagnostics") -> None:
        """Add the lateness of the loop since its start, and the events of the run."""
        schedule, lateness, wall_ns = self.schedule, self.schedule.lateness, max(now_ns() - self.started_ns, 1)
        figures.loop_rate_hz = NS_PER_S / schedule.period_ns
        figures.real_time_factor = schedule.due_total * schedule.period_ns / wall_ns
        figures.lateness_p50_us = lateness.quantile(0.5) / NS_PER_US
        figures.lateness_p99_us = lateness.quantile(0.99) / NS_PER_US
        figures.lateness_p999_us = lateness.quantile(0.999) / NS_PER_US
        figures.lateness_max_us = lateness.maximum / NS_PER_US
        figures.within_2ms = lateness.share_within(2 * NS_PER_MS)
        figures.behind_ms = (wall_ns - (schedule.due_total + schedule.skipped) * schedule.period_ns) / NS_PER_MS
        figures.steps_skipped = schedule.skipped
        self.watch.add_figures(figures)
