"""The real-time loop: handle commands as they arrive, step the physics on schedule, publish samples when due."""

import select
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

from hil.common.clock import NS_PER_MS, NS_PER_S, RateKeeper, now_ns, to_wall_ns
from hil.links.contract import PWM_NEUTRAL_US, ThrusterTelemetry, has_restarted, is_overtaken
from hil.slave.command_receiver import CommandReceiver, Received
from hil.slave.drivers.driver import ThrusterDriver
from hil.slave.pilot import Pilot
from hil.slave.run_watch import RunWatch
from hil.slave.sample_publisher import SamplePublisher
from sim.simulation import Simulation

if TYPE_CHECKING:
    from hil.ros.diagnostics import Diagnostics
    from hil.slave.autopilot_port import AutopilotPort
    from sim.vehicle.failures import Failure

UNANSWERED_NS = NS_PER_S  # a command whose echo has not arrived after this time counts as lost on the link
TRACE_WAIT_NS = NS_PER_S // 20  # simulation time that a trace waits for a sample to be sent with


class NodeServer(Protocol):
    """Serve the slave as a ROS 2 node in the loop's thread: hil.slave.ros.node.RosNode."""

    due_ns: int  # simulation time of the next `tick`

    def fileno(self) -> int:
        """Return the descriptor to wait on."""

    def serve(self) -> None:
        """Answer one service call."""

    def tick(self, time_ns: int) -> None:
        """Publish what is due at this simulation time."""

    def add_figures(self, figures: "Diagnostics") -> None:
        """Add the counters of the services."""

    def close(self) -> None:
        """Close the descriptor."""


class Trace(NamedTuple):
    """Times of one command, in ns since 1970, after its sequence number on the network.

    `published_ns` is by the master's clock, all others by the slave's: `received_ns` by the network thread, `taken_ns`
    by the loop, `computed_ns` when the thrusts were computed, `written_ns` to the thruster link, and `applied_ns` by
    the STM32.
    """

    sequence: int
    published_ns: int
    received_ns: int
    taken_ns: int
    written_ns: int
    applied_ns: int
    computed_ns: int


class Loop:
    """Run one vehicle. The parts are passed in; nothing is opened or closed here.

    While `armed` is false no command is applied; while `paused` is true the simulation is not stepped. `ros` is set
    after the vehicle is ready, `autopilot` if an autopilot replaces the pilot.
    """

    def __init__(
        self,
        simulation: Simulation,
        driver: ThrusterDriver,
        pilot: Pilot | None,
        command_receiver: CommandReceiver,
        sample_publisher: SamplePublisher,
        step_ns: int,
        control_period_ns: int,
        report: Callable[[str], None],
    ) -> None:
        self.simulation = simulation
        self.driver = driver
        self.pilot = pilot
        self.command_receiver = command_receiver
        self.sample_publisher = sample_publisher
        self.armed = True
        self.paused = False
        self.ros: NodeServer | None = None
        self.autopilot: AutopilotPort | None = None
        if simulation.accessories:
            command_receiver.move = self.move
        self._control_period_ns = control_period_ns
        # Control at the step nearest to the end of the period, not at the one after it.
        self._control_wait_ns = control_period_ns - step_ns // 2
        self._report = report
        # Commands that wait for their echo: link sequence number -> command, times taken, computed and written (ns).
        self._awaited: dict[int, tuple[Received, int, int, int]] = {}
        self._counted_ns = 0  # when `_awaited` was last searched for unanswered commands
        self._traces: list[Trace] = []  # to be published
        self._traces_due_ns = 0  # simulation time at which they are published at the latest
        self._controlled_ns = 0
        self._computed_ns = 0
        self._control_due_ns = 0
        self._neutral = (PWM_NEUTRAL_US,) * len(driver.pwm_us)
        self.pwm_us = driver.pwm_us  # the same tuple object as long as it is unchanged, which a step detects quickly
        self._link_due_ns = 0  # when the driver has to be serviced even if no byte has arrived
        self._link_fds = driver.descriptors
        self._stopping_ns = 0  # when the deadman tripped; 0 once the STM32 has confirmed neutral thrusters
        self._newest: ThrusterTelemetry | None = None  # newest telemetry received
        self.schedule = RateKeeper(step_ns, now_ns())
        self._stamped = -1  # value of `schedule.skipped` when the present epoch of the stamps began
        self.commands = 0
        self.unanswered = 0
        self.watchdog_trips = 0
        self.watch = RunWatch(simulation, driver, pilot, report)
        self.started_ns = now_ns()

    def run(self, stop_fd: int) -> None:
        """Run until `stop_fd` becomes readable."""
        command_fd = self.command_receiver.fileno()
        ros_fd = self.ros.fileno() if self.ros else -1
        autopilot, autopilot_fd = self.autopilot, self.autopilot.fileno() if self.autopilot else -1
        own_fds = [stop_fd, command_fd, *([ros_fd] if self.ros else []), *([autopilot_fd] if autopilot else [])]
        link_fds, fds = self._link_fds, own_fds + self._link_fds
        self.started_ns = now_ns()
        schedule = self.schedule = RateKeeper(self.schedule.period_ns, self.started_ns)
        while True:
            if link_fds is not self._link_fds:  # the link was lost or is back
                link_fds, fds = self._link_fds, own_fds + self._link_fds
            ready = select.select(fds, (), (), schedule.timeout())[0]
            now = now_ns() if ready else schedule.on_wakeup()
            if ready:  # most wake-ups are only for the next step
                if command_fd in ready:
                    self._apply_command(now)
                if stop_fd in ready:
                    self._publish_traces()
                    self.sample_publisher.wake_publisher()
                    return
            if autopilot and (autopilot_fd in ready or now >= autopilot.due_ns):
                self._serve_autopilot(autopilot, now)
            if now >= self._control_due_ns and self.pilot:
                self._control(self.pilot, now)
            if now >= self._link_due_ns or (ready and any(fd in ready for fd in link_fds)):
                self._service_link(now_ns())
            if now >= schedule.deadline_ns:
                self.advance_to(now)
            if ready and self.ros and ros_fd in ready:
                self.ros.serve()  # after the step, when there is time until the next one

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
        self.advance(self.autopilot.permitted_steps(steps) if self.autopilot else steps)

    def _stamp_from(self, instant_ns: int) -> None:
        """Set the stamps so that the next step begins at this monotonic time (ns)."""
        self.stamp(instant_ns + self.sample_publisher.stamps.offset_ns - self.simulation.time_ns)

    def stamp(self, epoch_ns: int) -> None:
        """Let simulation time 0 be this time (ns since 1970) from the next step on; see `hil.recording.stamps`."""
        self.sample_publisher.stamps.begin(self.simulation.time_ns, epoch_ns)

    def advance(self, steps: int) -> None:
        """Advance the simulation by this number of steps, and publish the sensor samples of each."""
        sent = False
        autopilot = self.autopilot
        for _ in range(steps):
            for topic, sample in self.simulation.step(self.pwm_us):
                if self.pilot:
                    self.pilot.update_sensor(topic, sample)
                if autopilot:
                    autopilot.update_sensor(topic, sample)
                sent |= self.sample_publisher.publish_sample(topic, sample)
            if autopilot:
                autopilot.advance(self.simulation)
        if self._traces and (sent or self.simulation.time_ns >= self._traces_due_ns):
            self._publish_traces()  # with other messages: alone they would cost one more wake-up of the publisher
        if self.simulation.time_ns >= self.watch.due_ns:
            self.watch.check()
        ros = self.ros
        if ros and self.simulation.time_ns >= ros.due_ns:
            ros.tick(self.simulation.time_ns)
        self.sample_publisher.wake_publisher()

    def set_state(self, position: Sequence[float], quaternion: Sequence[float], nu: Sequence[float]) -> None:
        """Set the vehicle's state (position NED, quaternion body to NED, nu FRD) between steps; thrusters neutral."""
        state = self.simulation.state
        state.position, state.quaternion, state.nu = list(position), list(quaternion), list(nu)
        state.nu_dot = [0.0] * 6
        if self.simulation.tether:
            self.simulation.tether.restart()
        self.set_neutral()

    def fail(self, *failures: "Failure") -> None:
        """Set or clear thruster failures from the next step on. Raises ConfigError for an unknown thruster."""
        self.simulation.fail(*failures)

    def move(self, shares: Mapping[str, float]) -> None:
        """Command accessories, each to its share; called in the reader's thread."""
        for name, share in shares.items():
            if accessories := self.simulation.accessories:
                accessories.command(name, share, self.simulation.time_ns)

    def set_neutral(self) -> None:
        """Set the thrusters to neutral until the next command."""
        if self.pilot:
            self.pilot.active = False

    def next_sequence(self) -> int:
        """Return the sequence number of the next command on the link; 0 if another program sends the commands."""
        sender = self.pilot or self.autopilot
        return sender.next_sequence() if sender else 0

    def _apply_command(self, now: int) -> None:
        received = self.command_receiver.take_latest()
        if received is None or self.pilot is None or not self.armed:
            return
        self.commands += 1
        if self.driver.arming_refusal:
            self.set_neutral()
            return
        if not self.pilot.active:
            self._report("commands arrive: thrusters armed")
        self.pilot.set_command(received.command, now)
        sequence = self._control(self.pilot, now)
        self._awaited[sequence] = (received, now, self._computed_ns, now_ns())

    def _serve_autopilot(self, autopilot: "AutopilotPort", now: int) -> None:
        """Send the autopilot's outputs at once; in lockstep do a step that waited for them."""
        command = autopilot.take_outputs(now)
        if now >= autopilot.due_ns:
            command = autopilot.check(now) or command
        if command:
            armed = self.armed and command.armed
            self.driver.send(command if armed else command._replace(armed=False, pwm_us=self._neutral))
            self._service_link(now_ns())  # so that a step that follows at once uses the new pulse widths
            self.advance(autopilot.permitted_steps(0))

    def _control(self, pilot: Pilot, now: int) -> int:
        """Update the controller and send its thrusts at once; return their sequence number on the link."""
        dt_ns = min(now - self._controlled_ns, 2 * self._control_period_ns)
        self._controlled_ns = now
        self._control_due_ns = now + self._control_wait_ns
        command, tripped = pilot.update(now, max(dt_ns, 1000) / NS_PER_S)
        self._computed_ns = now_ns()
        self.driver.send(command)
        self._follow_driver()
        if tripped:
            self._report("deadman: no command in time, stopping the thrusters")
            self._stopping_ns = now
        return command.sequence

    def _follow_driver(self) -> None:
        """Copy what the driver changes when it sends or is serviced."""
        driver = self.driver
        self._link_due_ns, self._link_fds, self.pwm_us = driver.deadline_ns, driver.descriptors, driver.pwm_us

    def _service_link(self, now: int) -> None:
        received = self.driver.service(now)
        now = now_ns() if received else now  # the read took time, which counts into the delay
        self._follow_driver()
        for telemetry in received:
            if self._newest is None or not is_overtaken(telemetry, self._newest):
                self._apply_telemetry(telemetry)
            if self._awaited:
                self._trace(telemetry, now)
            if self.autopilot:
                self.autopilot.record_echo(telemetry.sequence, self.driver.applied_ns(telemetry, now))
        if received and self._stopping_ns and self._newest:
            self._confirm_stop(self._newest, now)
        if now - self._counted_ns > UNANSWERED_NS:
            self._count_unanswered(now)

    def _apply_telemetry(self, telemetry: ThrusterTelemetry) -> None:
        """Store the newest telemetry; report a watchdog trip or a restart of the STM32."""
        newest = self._newest
        if telemetry.timed_out and not (newest and newest.timed_out):
            self._report("the STM32's watchdog tripped: thrusters neutral")
        if newest and has_restarted(telemetry, newest):
            self._report("the STM32 has restarted")
        self._newest = telemetry
        self.watchdog_trips = telemetry.watchdog_trips

    def _confirm_stop(self, telemetry: ThrusterTelemetry, now: int) -> None:
        """Report neutral thrusters once the STM32 confirms them; give up if a new command has armed them."""
        if self.pilot and self.pilot.active:
            self._stopping_ns = 0
        elif all(pulse == PWM_NEUTRAL_US for pulse in telemetry.pwm_us):
            took_ms = (now - self._stopping_ns) / NS_PER_MS
            self._report(f"thrusters neutral: confirmed by the STM32 {took_ms:.0f} ms after the deadman")
            self._stopping_ns = 0

    def _trace(self, telemetry: ThrusterTelemetry, now: int) -> None:
        awaited = self._awaited.pop(telemetry.sequence, None)
        if awaited:
            received, taken_ns, computed_ns, written_ns = awaited
            applied_ns = self.driver.applied_ns(telemetry, now)
            instants = map(to_wall_ns, (received.received_ns, taken_ns, written_ns, applied_ns, computed_ns))
            if not self._traces:
                self._traces_due_ns = self.simulation.time_ns + TRACE_WAIT_NS
            self._traces.append(Trace(received.sequence, received.published_ns, *instants))

    def _publish_traces(self) -> None:
        traces, self._traces = self._traces, []
        for trace in traces:
            self.sample_publisher.publish_trace(trace)

    def _count_unanswered(self, now: int) -> None:
        """Count and remove commands that the STM32 did not echo in time."""
        self._counted_ns = now
        lost = [sequence for sequence, (_, _, _, written) in self._awaited.items() if now - written > UNANSWERED_NS]
        for sequence in lost:
            del self._awaited[sequence]
        self.unanswered += len(lost)
