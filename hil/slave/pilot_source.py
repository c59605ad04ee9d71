"""Let our own controller command the thrusters, after the commands of a master, and trace each command."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from hil.common.clock import NS_PER_MS, NS_PER_S, now_ns, to_wall_ns
from hil.links.contract import PWM_NEUTRAL_US, ThrusterTelemetry
from hil.slave.command_receiver import CommandReceiver, Received
from hil.slave.command_source import CommandSource
from hil.slave.drivers.driver import ThrusterDriver
from hil.slave.pilot import Pilot
from sim.simulation import Simulation

if TYPE_CHECKING:
    from hil.ros.diagnostics import Diagnostics

TRACE_WAIT_NS = NS_PER_S // 20  # simulation time that a trace waits for a sample to be sent with


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


class PilotSource(CommandSource):
    """The pilot, updated when a command arrives and at least every `control_period_ns` (minus half a step).

    `publish` publishes the traces of commands that the STM32 has applied. `report` gets lines for the log.
    """

    kind = "builtin"
    pilot: Pilot
    can_arm = True
    software = ""

    def __init__(
        self,
        pilot: Pilot,
        driver: ThrusterDriver,
        receiver: CommandReceiver,
        control_period_ns: int,
        step_ns: int,
        publish: Callable[[Trace], None],
        report: Callable[[str], None],
    ) -> None:
        super().__init__(driver)
        self.pilot, self._receiver = pilot, receiver
        self._period_ns = control_period_ns
        # Control at the step nearest to the end of the period, not at the one after it.
        self._wait_ns = control_period_ns - step_ns // 2
        self._publish, self._report = publish, report
        pilot.report = report
        self._controlled_ns = self.due_ns = 0
        self._stopping_ns = 0  # when the deadman tripped; 0 once the STM32 has confirmed neutral thrusters
        self._traces: list[Trace] = []  # to be published
        self._traces_due_ns = 0  # simulation time at which they are published at the latest
        self._time_ns = 0  # simulation time

    @property
    def requested_depth(self) -> float | None:  # type: ignore[override]
        """The depth (m) that the present command requests; None without one."""
        return self.pilot.requested_depth

    def fileno(self) -> int:
        """Return the descriptor that is readable when a command has arrived."""
        return self._receiver.fileno()

    def serve(self, now: int) -> bool:
        """Apply a new command; update the controller for it, or because that is due, and send its thrusts at once."""
        received = self._take_command(now)
        if received is None and now < self.due_ns:
            return False
        dt_ns = min(now - self._controlled_ns, 2 * self._period_ns)
        self._controlled_ns, self.due_ns = now, now + self._wait_ns
        command, tripped = self.pilot.update(now, max(dt_ns, 1000) / NS_PER_S)
        self._send(command, received and (received, now, now_ns()))
        if tripped:
            self._report("deadman: no command in time, stopping the thrusters")
            self._stopping_ns = now
        return True

    def update_sensor(self, topic: str, sample: Any) -> None:
        """Update the navigation."""
        self.pilot.update_sensor(topic, sample)

    def end_step(self, simulation: Simulation, has_sent: bool) -> None:
        """Publish traces with other messages, because alone they would cost one more wake-up of the publisher."""
        self._time_ns = simulation.time_ns
        if self._traces and (has_sent or self._time_ns >= self._traces_due_ns):
            self.finish()

    def finish(self) -> None:
        """Publish the traces."""
        traces, self._traces = self._traces, []
        for trace in traces:
            self._publish(trace)

    def handle_telemetry(self, received: list[ThrusterTelemetry], now: int) -> None:
        """Trace the commands that are echoed; report neutral thrusters after the deadman."""
        super().handle_telemetry(received, now)
        if received and self._stopping_ns and self._driver.newest:
            self._confirm_stop(self._driver.newest, now)

    def set_neutral(self) -> None:
        """Set the thrusters to neutral until the next command."""
        self.pilot.active = False

    def add_figures(self, figures: "Diagnostics") -> None:
        """Add what is known of commands and thrusters."""
        super().add_figures(figures)
        figures.thrusters_failed = ", ".join(self.pilot.failed_thrusters)
        figures.thrusters_unwatched = ", ".join(self.pilot.unwatched_thrusters)

    def next_sequence(self) -> int:
        """Return the sequence number of the next command on the thruster link."""
        return self.pilot.next_sequence()

    def problem(self) -> str:
        """Return that no master commands; "" if one does."""
        if self.pilot.active:
            failed = ", ".join(self.pilot.failed_thrusters)
            return f"failed: {failed}: the other thrusters take over what they can" if failed else ""
        neutral = all(pulse == PWM_NEUTRAL_US for pulse in self._driver.pwm_us)
        return "waiting for commands, thrusters " + ("neutral" if neutral else "not neutral yet")

    def _take_command(self, now: int) -> Received | None:
        """Give the pilot a new command; return it. None if there is none, or if it must not drive the thrusters."""
        received = self._receiver.take_latest()
        if received is None or not self.armed:
            return None
        self.commands += 1
        if self._driver.arming_refusal:
            self.set_neutral()
            return None
        if not self.pilot.active:
            self._report("commands arrive: thrusters armed")
        self.pilot.set_command(received.command, now)
        return received

    def _record_echo(self, awaited: tuple[int, Any], applied_ns: int) -> None:
        written_ns, (received, taken_ns, computed_ns) = awaited
        instants = map(to_wall_ns, (received.received_ns, taken_ns, written_ns, applied_ns, computed_ns))
        if not self._traces:
            self._traces_due_ns = self._time_ns + TRACE_WAIT_NS
        self._traces.append(Trace(received.sequence, received.published_ns, *instants))

    def _confirm_stop(self, telemetry: ThrusterTelemetry, now: int) -> None:
        """Report neutral thrusters once the STM32 confirms them; give up if a new command has armed them."""
        if self.pilot.active:
            self._stopping_ns = 0
        elif all(pulse == PWM_NEUTRAL_US for pulse in telemetry.pwm_us):
            took_ms = (now - self._stopping_ns) / NS_PER_MS
            self._report(f"thrusters neutral: confirmed by the STM32 {took_ms:.0f} ms after the deadman")
            self._stopping_ns = 0
