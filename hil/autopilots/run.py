"""Run one vehicle with its autopilot in one process: step by step with it in lockstep, or by the clock without.

Nothing happens before the autopilot is there; the run then lasts for the scenario's [master] time_limit of simulated
time. Who flies the vehicle is a ground station, or a program of the user, connected to the autopilot.
"""

import select
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Any

from hil.autopilots.contract import CHECK_NS, Report
from hil.autopilots.opening import open_autopilot, start_program
from hil.common.clock import NS_PER_S, Histogram, now_ns, seconds_ns
from hil.common.errors import DeviceError
from hil.scenario.config import Scenario, build_simulation
from sim.environment.world import load_world
from sim.run_events import PERIOD_NS, EventLog, RunMonitor
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle

PATIENCE_NS = 60 * NS_PER_S  # without a word of the autopilot, before a run is given up

Watch = Callable[["AutopilotRun"], None]


class AutopilotRun:
    """The vehicle of a scenario and its autopilot, at time 0. Use as a context. Raises ConfigError, DeviceError.

    `pwm_us` are the pulse widths of the last step, `samples` the newest of each sensor by topic, `log` what went wrong
    beside the simulation's own events.
    """

    def __init__(self, scenario: Scenario, report: Report) -> None:
        vehicle, _ = load_vehicle(scenario.vehicle)
        world = load_world(scenario.world)
        self.simulation: Simulation = build_simulation(scenario, vehicle, world)
        self.samples: dict[str, Any] = {}
        self.log = EventLog()
        self._monitor = RunMonitor(self.log, vehicle.capsize_tilt, 0.5 * vehicle.dimensions[2])
        self._monitor_ns = 0
        self._step_ns = seconds_ns(scenario.slave.step)
        self._stack = ExitStack()
        try:
            self.autopilot, self.motors = open_autopilot(scenario, vehicle, world, report)
            self._stack.callback(self.autopilot.close)
            self.program = start_program(scenario, vehicle, world, report)
            if self.program:
                self._stack.callback(self.program.close)
        except BaseException:
            self._stack.close()
            raise
        self.pwm_us = self.motors.map.neutral
        self.is_dry = False  # outputs are taken, and the thrusters stay neutral
        self.round_trip = Histogram()  # ns, from a state that was sent to the outputs that answer it
        self._sent_ns = 0  # of the state that is not answered; 0 if there is none
        self._due_ns = self._checked_ns = now_ns()

    def __enter__(self) -> "AutopilotRun":
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def step(self) -> None:
        """Wait for the autopilot, then advance by one step. Raises DeviceError if it stays away or has ended."""
        if self.autopilot.lockstep:
            self._await(self._is_answered)
        else:
            self._await(self._is_due)
            self._due_ns = max(self._due_ns + self._step_ns, now_ns() - 40 * self._step_ns)
        simulation, autopilot = self.simulation, self.autopilot
        for topic, sample in simulation.step(self.pwm_us):
            autopilot.update_sensor(topic, sample)
            self.samples[topic] = sample
        states = autopilot.figures.states
        autopilot.advance(simulation.time_ns, simulation.truth())
        if autopilot.figures.states != states:
            self._sent_ns = now_ns()
        if simulation.time_ns >= self._monitor_ns:
            self._monitor_ns = simulation.time_ns + PERIOD_NS
            state = simulation.state
            self._monitor.observe(simulation.time_ns, state.position, state.quaternion, None)

    def run(self, seconds: float, watches: Sequence[Watch] = ()) -> None:
        """Advance until simulated time is `seconds`."""
        end_ns = seconds_ns(seconds)
        while self.simulation.time_ns < end_ns:
            self.step()
            for watch in watches:
                watch(self)

    def _is_answered(self) -> bool:
        return self.autopilot.connected and self.autopilot.may_step()

    def _is_due(self) -> bool:
        """Return whether the clock wants the next step; the first one waits for the autopilot."""
        return (self.autopilot.connected or self.simulation.time_ns > 0) and now_ns() >= self._due_ns

    def _await(self, is_ready: Callable[[], bool]) -> None:
        """Take outputs until `is_ready`."""
        began = now_ns()
        while True:
            # A look before anything can have come costs as much as the step: in lockstep the answer is waited for.
            patience = self.autopilot.patience_ns() if self.autopilot.lockstep else self._due_ns - now_ns()
            seconds = 0.0 if is_ready() else max(0, min(patience, CHECK_NS)) / NS_PER_S
            readable = select.select([self.autopilot.fileno()], [], [], seconds)[0]
            outputs = self.autopilot.receive(now_ns()) if readable else None
            if outputs:
                self.motors.update(outputs)
                if self._sent_ns:
                    self.round_trip.add(outputs.received_ns - self._sent_ns)
                    self._sent_ns = 0
            now = now_ns()
            if now - self._checked_ns > CHECK_NS:  # also where no step waits for so long
                self._checked_ns = now
                self.autopilot.check(now)
                self._check_program(now - began)
            if is_ready():
                break
        # In lockstep no simulated time passes while the autopilot is silent, so that its last outputs hold.
        motors = self.motors
        pulses = (motors.latest if self.autopilot.lockstep else motors.at(now_ns())).pwm_us
        self.pwm_us = self.motors.map.neutral if self.is_dry else pulses

    def _check_program(self, waited_ns: int) -> None:
        ended = self.program.ended() if self.program else None
        if ended:
            raise DeviceError(ended)
        if waited_ns > PATIENCE_NS:
            raise DeviceError(
                f"{self.autopilot.name}: nothing came for {waited_ns / NS_PER_S:.0f} s: "
                "start the autopilot, or name its program in [autopilot] program"
            )
