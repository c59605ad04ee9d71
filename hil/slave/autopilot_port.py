"""The slave's interface to an autopilot: its motor outputs become STM32 commands; it receives samples and step times.

Loaded only if the scenario's controller is an autopilot. In lockstep, each due step waits for the autopilot's answer.
Steps that wait are made up for later, at most `MAX_OWED`; further ones are dropped and counted, and simulated time
then falls behind. The simulation does not wait for an autopilot that is not connected.
"""

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any

from hil.common.clock import NS_PER_MS, Histogram
from hil.links.contract import PWM_NEUTRAL_US, ThrusterCommand
from hil.scenario.config import Scenario
from hil.slave.command_source import CommandSource
from hil.slave.drivers.driver import ThrusterDriver
from sim.environment.world import World
from sim.simulation import Simulation
from sim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from hil.ros.diagnostics import Diagnostics

MAX_OWED = 40  # steps; 0.1 s at the default step
CHECK_NS = 50 * NS_PER_MS


class AutopilotPort(CommandSource):
    """One autopilot: opens its connection; starts its program if configured. Raises ConfigError, DeviceError.

    `delay` is a histogram of the ns from the arrival of outputs to the time when the STM32 applied their pulse widths.
    """

    kind = "autopilot"
    can_arm = keeps_step = True

    def __init__(
        self,
        scenario: Scenario,
        vehicle: Vehicle,
        world: World,
        driver: ThrusterDriver,
        report: Callable[[str], None],
    ) -> None:
        super().__init__(driver)
        self._neutral = (PWM_NEUTRAL_US,) * len(driver.pwm_us)
        opening = import_module("hil.autopilots.opening")
        self.autopilot, self.motors = opening.open_autopilot(scenario, vehicle, world, report)
        try:
            self._program = opening.start_program(scenario, vehicle, world, report)
        except BaseException:
            self.autopilot.close()
            raise
        self.delay = Histogram()
        self.held_steps = 0  # steps dropped because the autopilot did not answer in time
        self.due_ns = 0
        self._owed = 0
        self._report = report
        self._has_ended = False

    @property
    def software(self) -> str:
        """The autopilot's name."""
        return str(self.autopilot.name)

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return int(self.autopilot.fileno())

    def serve(self, now: int) -> bool:
        """Send new motor outputs at once, neutral while disarmed; report problems when that is due. Raises DeviceError.

        The thrusters are stopped if the autopilot has just timed out.
        """
        outputs = self.autopilot.receive(now)
        pulses = self.motors.update(outputs) if outputs else None
        if now >= self.due_ns:
            pulses = self._check(now) or pulses
        if pulses is None:
            return False
        armed = self.armed and pulses.armed
        command = ThrusterCommand(self.next_sequence(), armed, pulses.pwm_us if armed else self._neutral)
        self._send(command, outputs and outputs.received_ns)
        return True

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

    def end_step(self, simulation: Simulation, has_sent: bool) -> None:
        """Report to the autopilot that a step has ended. Raises DeviceError."""
        self.motors.move_accessories(simulation)
        self.autopilot.advance(simulation.time_ns, simulation.truth())

    def add_figures(self, figures: "Diagnostics") -> None:
        """Add the autopilot's figures."""
        super().add_figures(figures)
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

    def problem(self) -> str:
        """Return that the autopilot is absent or silent; "" if it commands."""
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

    def _check(self, now: int) -> Any:
        """Report problems; return the pulse widths that stop the thrusters if the autopilot has just timed out."""
        self.due_ns = now + CHECK_NS
        self.autopilot.check(now)
        ended = self._program.ended() if self._program and not self._has_ended else None
        if ended:
            self._has_ended = True
            self._report(ended)
        silences, pulses = self.motors.silences, self.motors.at(now)
        return pulses if self.motors.silences != silences else None

    def _record_echo(self, awaited: tuple[int, Any], applied_ns: int) -> None:
        self.delay.add(applied_ns - awaited[1])
