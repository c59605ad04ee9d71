"""The slave's interface to an autopilot: its motor outputs become STM32 commands; it receives samples and step times.

Loaded only if the scenario's controller is an autopilot. In lockstep, each due step waits for the autopilot's answer.
Steps that wait are made up for later, at most `MAX_OWED`; further ones are dropped and counted, and simulated time
then falls behind. The simulation does not wait for an autopilot that is not connected.
"""

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any

from hil.common.clock import NS_PER_MS, Histogram
from hil.links.contract import ThrusterCommand
from hil.scenario.config import Scenario
from sim.environment.world import World
from sim.simulation import Simulation
from sim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from hil.ros.diagnostics import Diagnostics

MAX_OWED = 40  # steps; 0.1 s at the default step
MAX_AWAITED = 256  # commands that wait for their echo
CHECK_NS = 50 * NS_PER_MS


class AutopilotPort:
    """One autopilot: opens its connection; starts its program if configured. Raises ConfigError, DeviceError.

    `delay` is a histogram of the ns from the arrival of outputs to the time when the STM32 applied their pulse widths.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, world: World, report: Callable[[str], None]) -> None:
        opening = import_module("hil.autopilots.opening")
        self.autopilot, self.motors = opening.open_autopilot(scenario, vehicle, world, report)
        try:
            self._program = opening.start_program(scenario, vehicle, world, report)
        except BaseException:
            self.autopilot.close()
            raise
        self.delay = Histogram()
        self.held_steps = 0  # steps dropped because the autopilot did not answer in time
        self.due_ns = 0  # when `check` has to be called
        self._owed = 0
        self._report = report
        self._sequence = 0
        self._awaited: dict[int, int] = {}  # sequence -> arrival of the outputs
        self._has_ended = False

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return int(self.autopilot.fileno())

    def take_outputs(self, now: int) -> ThrusterCommand | None:
        """Return the STM32 command for new motor outputs; None if there are none. Raises DeviceError."""
        outputs = self.autopilot.receive(now)
        if outputs is None:
            return None
        pulses = self.motors.update(outputs)
        command = self._command(pulses)
        if len(self._awaited) > MAX_AWAITED:
            self._awaited.clear()
        self._awaited[command.sequence] = outputs.received_ns
        return command

    def check(self, now: int) -> ThrusterCommand | None:
        """Report problems; return a command that stops the thrusters if the autopilot has just timed out."""
        self.due_ns = now + CHECK_NS
        self.autopilot.check(now)
        ended = self._program.ended() if self._program and not self._has_ended else None
        if ended:
            self._has_ended = True
            self._report(ended)
        silences = self.motors.silences
        pulses = self.motors.at(now)
        return self._command(pulses) if self.motors.silences != silences else None

    def record_echo(self, sequence: int, applied_ns: int) -> None:
        """Add the delay of the command with this sequence number, which the STM32 has echoed, to the histogram."""
        received_ns = self._awaited.pop(sequence, None)
        if received_ns is not None:
            self.delay.add(applied_ns - received_ns)

    def permitted_steps(self, due: int) -> int:
        """Return how many steps to do now that `due` more are due; in lockstep one, and only after an answer."""
        if not self.autopilot.lockstep or not self.autopilot.connected:
            self._owed = 0
            return due
        self._owed += due
        if self._owed > MAX_OWED:
            self.held_steps += self._owed - MAX_OWED
            self._owed = MAX_OWED
        if not self._owed or not self.autopilot.may_step():
            return 0
        self._owed -= 1
        return 1

    def update_sensor(self, topic: str, sample: Any) -> None:
        """Pass one sample to the autopilot."""
        self.autopilot.update_sensor(topic, sample)

    def advance(self, simulation: Simulation) -> None:
        """Report to the autopilot that a step has ended. Raises DeviceError."""
        self.motors.move_accessories(simulation)
        self.autopilot.advance(simulation.time_ns, simulation.truth())

    def next_sequence(self) -> int:
        """Return the sequence number of the next command on the thruster link."""
        self._sequence = (self._sequence + 1) & 0xFFFF
        return self._sequence

    def add_figures(self, figures: "Diagnostics") -> None:
        """Add the autopilot's figures."""
        counters = self.autopilot.figures
        figures.autopilot = self.autopilot.name
        figures.autopilot_connected = self.autopilot.connected
        figures.autopilot_frame = self.motors.map.frame
        figures.autopilot_outputs = self.motors.outputs
        figures.autopilot_packets = counters.outputs
        figures.autopilot_duplicates = counters.duplicates
        figures.autopilot_malformed = counters.malformed
        figures.autopilot_lost = counters.lost
        figures.autopilot_resets = counters.resets
        figures.autopilot_stalls = counters.stalls
        figures.autopilot_silences = self.motors.silences
        figures.autopilot_steps_held = self.held_steps
        figures.autopilot_delay_p50_ms = self.delay.quantile(0.5) / NS_PER_MS
        figures.autopilot_delay_p99_ms = self.delay.quantile(0.99) / NS_PER_MS
        if self.autopilot.estimate:
            self.autopilot.estimate.add_figures(figures)

    def state(self) -> str:
        """Return the problem in words; "" if there is none."""
        if not self.autopilot.connected:
            return f"waiting for {self.autopilot.name}, thrusters neutral"
        if not self.motors.outputs:
            return f"{self.autopilot.name} is silent, thrusters neutral"
        return ""

    def close(self) -> None:
        """Close the connection and end the autopilot program."""
        self.autopilot.close()
        if self._program:
            self._program.close()

    def _command(self, pulses: Any) -> ThrusterCommand:
        return ThrusterCommand(self.next_sequence(), pulses.armed, pulses.pwm_us)
