"""The real-time loop: commands when they come, physics on an absolute schedule, samples when they are due."""

import select
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

from hil.clock import NS_PER_S, RateKeeper, now_ns, to_wall_ns
from hil.links.contract import ThrusterTelemetry
from hil.slave.inbox import Inbox, Received
from hil.slave.outbox import Outbox
from hil.slave.pilot import Pilot
from hil.slave.stm32 import ThrusterDriver
from sim.simulation import Simulation

if TYPE_CHECKING:
    from hil.slave.ros_node import RosNode
    from sim.failures import Failure

WRAP = 0x10000  # of what telemetry counts
UNANSWERED_NS = NS_PER_S  # a command whose echo has not come by then is counted as lost on the link
TRACE_WAIT_NS = NS_PER_S // 20  # for a message that a trace can go out with; of simulation time


class Trace(NamedTuple):
    """The way of one command: its network sequence number, then instants in ns since 1970.

    `published_ns` is by the master's clock, all others by the slave's: received by the network thread,
    taken up by the loop, written to the thruster link, applied by the STM32; and between taken up and written,
    when the thrusts were computed.
    """

    sequence: int
    published_ns: int
    received_ns: int
    taken_ns: int
    written_ns: int
    applied_ns: int
    computed_ns: int


class Loop:
    """Runs one vehicle. All parts are given; nothing is opened or closed here.

    While it is not `armed` no command is taken. `ros` is given when the vehicle is ready.
    """

    def __init__(
        self,
        simulation: Simulation,
        driver: ThrusterDriver,
        pilot: Pilot | None,
        inbox: Inbox,
        outbox: Outbox,
        step_ns: int,
        control_period_ns: int,
        report: Callable[[str], None],
    ) -> None:
        self.simulation = simulation
        self.driver = driver
        self.pilot = pilot
        self.inbox = inbox
        self.outbox = outbox
        self.armed = True
        self.ros: RosNode | None = None
        self._control_period_ns = control_period_ns
        self._control_wait_ns = control_period_ns - step_ns // 2  # the step nearest to the period's end, not one later
        self._report = report
        self._awaited: dict[int, tuple[Received, int, int, int]] = {}  # taken, computed, written
        self._counted_ns = 0  # when it was last looked through
        self._traces: list[Trace] = []  # still to be told
        self._traces_due_ns = 0  # of simulation time, at the latest
        self._controlled_ns = 0
        self._computed_ns = 0
        self._control_due_ns = 0
        self._sent = False
        self.pwm_us = tuple(driver.pwm_us)  # which change only when the driver is serviced
        self._link_due_ns = 0  # when the driver has to be serviced even if nothing came
        self._link_fds = driver.descriptors()
        self._timed_out = False
        self._frames = 0  # that the STM32 has counted
        self.schedule = RateKeeper(step_ns, now_ns())
        self.commands = 0
        self.unanswered = 0
        self.watchdog_trips = 0
        self.started_ns = now_ns()

    def run(self, stop_fd: int) -> None:
        """Loop until `stop_fd` becomes readable."""
        inbox_fd = self.inbox.fileno()
        ros_fd = self.ros.fileno() if self.ros else -1
        own_fds = [stop_fd, inbox_fd, *([ros_fd] if self.ros else [])]
        link_fds, fds = self._link_fds, own_fds + self._link_fds
        self.started_ns = now_ns()
        schedule = self.schedule = RateKeeper(self.schedule.period_ns, self.started_ns)
        while True:
            if link_fds is not self._link_fds:  # a lost link has gone, or come back
                link_fds, fds = self._link_fds, own_fds + self._link_fds
            ready = select.select(fds, (), (), schedule.timeout())[0]
            now = now_ns() if ready else schedule.woken()
            if ready:  # mostly it is only time for the next step
                if inbox_fd in ready:
                    self._take_command(now)
                if stop_fd in ready:
                    self._tell_traces()
                    return
            if now >= self._control_due_ns and self.pilot:
                self._control(self.pilot, now)
            if self._sent or now >= self._link_due_ns or (ready and any(fd in ready for fd in link_fds)):
                self._service_link(now_ns())  # the answer to a command just sent may be there already
            if now >= schedule.deadline_ns:
                self.advance(schedule.due(now))
            if ready and self.ros and ros_fd in ready:
                self.ros.serve()  # behind the step, so that there is time until the next

    def advance(self, steps: int) -> None:
        """Let the vehicle move by so many steps, and publish what its sensors then say."""
        sent = False
        for _ in range(steps):
            for topic, sample in self.simulation.step(self.pwm_us):
                if self.pilot:
                    self.pilot.sense(topic, sample)
                sent |= self.outbox.sample(topic, sample)
        if self._traces and (sent or self.simulation.time_ns >= self._traces_due_ns):
            self._tell_traces()  # nobody waits for them, and by themselves they would wake the network once more
        ros = self.ros
        if ros and self.simulation.time_ns >= ros.due_ns:
            ros.tick(self.simulation.time_ns)

    def place(self, position: Sequence[float], quaternion: Sequence[float], nu: Sequence[float]) -> None:
        """Put the vehicle somewhere (NED, body to world, FRD), between two steps; its next command begins anew."""
        state = self.simulation.state
        state.position, state.quaternion, state.nu = list(position), list(quaternion), list(nu)
        state.nu_dot = [0.0] * 6
        self.rest()

    def fail(self, *failures: "Failure") -> None:
        """Let thrusters fail, or be repaired, from the next step on. Raises ConfigError for an unknown thruster."""
        self.simulation.fail(*failures)

    def rest(self) -> None:
        """Neutral thrusters until the next command."""
        if self.pilot:
            self.pilot.active = False

    def _take_command(self, now: int) -> None:
        received = self.inbox.take()
        if received is None or self.pilot is None or not self.armed:
            return
        self.commands += 1
        if not self.pilot.active:
            self._report("commands arrive: thrusters armed")
        self.pilot.command(received.command, now)
        sequence = self._control(self.pilot, now)
        self._awaited[sequence] = (received, now, self._computed_ns, now_ns())

    def _control(self, pilot: Pilot, now: int) -> int:
        """One controller update, sent to the thrusters at once; its sequence number on the link."""
        dt_ns = min(now - self._controlled_ns, 2 * self._control_period_ns)
        self._controlled_ns = now
        self._control_due_ns = now + self._control_wait_ns
        command, tripped = pilot.update(now, max(dt_ns, 1000) / NS_PER_S)
        self._computed_ns = now_ns()
        self.driver.send(command)
        self._sent = True
        if tripped:
            self._report("deadman: no command in time, thrusters neutral")
        return command.sequence

    def _service_link(self, now: int) -> None:
        self._sent = False
        heard = self.driver.service(now)
        now = now_ns() if heard else now  # reading takes its time, and what was read is as old as that
        self._link_due_ns, self._link_fds = self.driver.deadline_ns, self.driver.descriptors()
        self.pwm_us = tuple(self.driver.pwm_us)  # a step knows it again at a glance
        for telemetry in heard:
            if telemetry.timed_out and not self._timed_out:
                self._report("the STM32's watchdog tripped: thrusters neutral")
            self._timed_out = telemetry.timed_out
            if 0 < self._frames - telemetry.frames < WRAP // 2:
                self._report("the STM32 has started anew")
            self._frames = telemetry.frames
            self.watchdog_trips = telemetry.watchdog_trips
            if self._awaited:
                self._trace(telemetry, now)
        if now - self._counted_ns > UNANSWERED_NS:
            self._count_unanswered(now)

    def _trace(self, telemetry: ThrusterTelemetry, now: int) -> None:
        awaited = self._awaited.pop(telemetry.sequence, None)
        if awaited:
            received, taken_ns, computed_ns, written_ns = awaited
            applied_ns = self.driver.applied_ns(telemetry, now)
            instants = map(to_wall_ns, (received.received_ns, taken_ns, written_ns, applied_ns, computed_ns))
            if not self._traces:
                self._traces_due_ns = self.simulation.time_ns + TRACE_WAIT_NS
            self._traces.append(Trace(received.sequence, received.published_ns, *instants))

    def _tell_traces(self) -> None:
        traces, self._traces = self._traces, []
        for trace in traces:
            self.outbox.trace(trace)

    def _count_unanswered(self, now: int) -> None:
        """What an STM32 that says nothing would let grow without end."""
        self._counted_ns = now
        lost = [sequence for sequence, (_, _, _, written) in self._awaited.items() if now - written > UNANSWERED_NS]
        for sequence in lost:
            del self._awaited[sequence]
        self.unanswered += len(lost)
