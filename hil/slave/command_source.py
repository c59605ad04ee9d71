"""What commands the thrusters: `PilotSource`, `AutopilotPort`, or software of the user's own."""

from typing import TYPE_CHECKING, Any

from hil.common.clock import NEVER_NS, NS_PER_S, now_ns
from hil.links.contract import ThrusterCommand, ThrusterTelemetry
from hil.slave.drivers.driver import ThrusterDriver
from sim.simulation import Simulation

if TYPE_CHECKING:
    from hil.ros.diagnostics import Diagnostics
    from hil.slave.pilot import Pilot

UNANSWERED_NS = NS_PER_S  # a command whose echo has not arrived after this time counts as lost on the link
DRIVEN_NS = NS_PER_S  # thrusters that got no command for this time count as not driven


class CommandSource:
    """Source of thruster commands. This class leaves them to other software, which has the link's host end.

    While `armed` is false no command is applied; `can_arm` is false if that is not ours to decide. `pilot` is our own
    controller, if that commands. `keeps_step`: the source decides when the simulation steps. `due_ns` (monotonic) is
    when `serve` has to be called even if the descriptor is not readable. `commands` counts commands of masters,
    `unanswered` those to the STM32 that it has not echoed.
    """

    kind = "external"
    pilot: "Pilot | None" = None
    can_arm = False
    keeps_step = False
    due_ns = NEVER_NS
    requested_depth: float | None = None  # depth (m) that the present command requests

    def __init__(self, driver: ThrusterDriver) -> None:
        self.armed = True
        self.commands = self.unanswered = 0
        self._driver = driver
        self._sequence = 0
        # Commands that wait for their echo: link sequence number -> when it was written (ns), what to measure.
        self._awaited: dict[int, tuple[int, Any]] = {}
        self._counted_ns = 0  # when `_awaited` was last searched for unanswered commands

    @property
    def software(self) -> str:
        """Who has to command before the thrusters move; "" if that is a master."""
        return f"your software on {self._driver.port}"

    def fileno(self) -> int:
        """Return the descriptor to wait on; -1 if there is none."""
        return -1

    def serve(self, now: int) -> bool:
        """Send what is due or has been requested at `now` (monotonic ns); return whether anything was sent."""
        return False

    def update_sensor(self, topic: str, sample: Any) -> None:
        """Use one sensor sample (NED, FRD)."""

    def end_step(self, simulation: Simulation, has_sent: bool) -> None:
        """Do what is due after a step. `has_sent`: samples of this step are on their way to subscribers."""

    def permitted_steps(self, due: int) -> int:
        """Return how many steps to do now that `due` more are due."""
        return due

    def handle_telemetry(self, received: list[ThrusterTelemetry], now: int) -> None:
        """Use the telemetry that arrived at `now` (monotonic ns), perhaps none; count commands without an echo."""
        if self._awaited:
            for telemetry in received:
                awaited = self._awaited.pop(telemetry.sequence, None)
                if awaited:
                    self._record_echo(awaited, self._driver.applied_ns(telemetry, now))
        if now - self._counted_ns > UNANSWERED_NS:
            self._counted_ns = now
            lost = [sequence for sequence, (written, _) in self._awaited.items() if now - written > UNANSWERED_NS]
            for sequence in lost:
                del self._awaited[sequence]
            self.unanswered += len(lost)

    def set_neutral(self) -> None:
        """Set the thrusters to neutral until the next command."""

    def next_sequence(self) -> int:
        """Return the sequence number of the next command on the thruster link."""
        self._sequence = (self._sequence + 1) & 0xFFFF
        return self._sequence

    def add_figures(self, figures: "Diagnostics") -> None:
        """Add what is known of the commands."""
        figures.controller, figures.armed = self.kind, self.armed
        if not self.can_arm:
            figures.thrusters_driven = now_ns() - self._driver.command_ns < DRIVEN_NS
        figures.commands_taken, figures.commands_unanswered = self.commands, self.unanswered
        figures.deadman_trips = self.pilot.deadman_trips if self.pilot else 0

    def problem(self) -> str:
        """Return what keeps the thrusters neutral, in words; "" if nothing does."""
        return ""

    def finish(self) -> None:
        """Publish what waits to be published."""

    def close(self) -> None:
        """Close what the source has opened."""

    def _send(self, command: ThrusterCommand, measured: Any = None) -> None:
        """Send a command; wait for its echo if there is something to measure."""
        self._driver.send(command)
        if measured is not None:
            self._awaited[command.sequence] = now_ns(), measured

    def _record_echo(self, awaited: tuple[int, Any], applied_ns: int) -> None:
        """Measure a command that the STM32 has echoed and applied at `applied_ns` (monotonic)."""
