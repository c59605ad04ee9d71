"""Run one vehicle with its autopilot in one process, in lockstep or in real time.

The run begins when the autopilot has connected, and lasts for the scenario's [master] time_limit of simulation time. A
ground station, or a program of the user, commands the vehicle through the autopilot.
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

TIMEOUT_NS = 60 * NS_PER_S  # without outputs of the autopilot, after which a run ends with an error

Watch = Callable[["AutopilotRun"], None]


class AutopilotRun:
    """The vehicle of a scenario and its autopilot. A context manager. Raises ConfigError, DeviceError.

    `pwm_us`: pulse widths of the last step. `samples`: the newest sample of each topic. `log`: events of the run other
    than those of the simulation. `ignores_outputs`: thrusters stay neutral. `round_trip`: ns from sending a state to
    receiving the outputs for it.
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
        self.ignores_outputs = False
        self.round_trip = Histogram()
        self._sent_ns = 0  # when the state was sent for which outputs are awaited; 0 if none are
        self._due_ns = self._checked_ns = now_ns()

    def __enter__(self) -> "AutopilotRun":
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def step(self) -> None:
        """Wait for the autopilot, then make one step. Raises DeviceError if it does not reply or has ended."""
        if self.autopilot.lockstep:
            self._await(self._is_answered)
        else:
            self._await(self._is_due)
            self._due_ns = max(self._due_ns + self._step_ns, now_ns() - 40 * self._step_ns)
        simulation, autopilot = self.simulation, self.autopilot
        for topic, sample in simulation.step(self.pwm_us):
            autopilot.update_sensor(topic, sample)
            self.samples[topic] = sample
        self.motors.move_accessories(simulation)
        states = autopilot.figures.states
        autopilot.advance(simulation.time_ns, simulation.truth())
        if autopilot.figures.states != states:
            self._sent_ns = autopilot.sent_ns
        if simulation.time_ns >= self._monitor_ns:
            self._monitor_ns = simulation.time_ns + PERIOD_NS
            state = simulation.state
            self._monitor.observe(simulation.time_ns, state.position, state.quaternion, None)

    def run(self, seconds: float, watches: Sequence[Watch] = ()) -> None:
        """Make steps until simulation time is `seconds`; call `watches` after each. Raises DeviceError."""
        end_ns = seconds_ns(seconds)
        while self.simulation.time_ns < end_ns:
            self.step()
            for watch in watches:
                watch(self)

    def _is_answered(self) -> bool:
        return self.autopilot.connected and self.autopilot.may_step()

    def _is_due(self) -> bool:
        """Return whether the next step is due by the clock; the first one also needs a connected autopilot."""
        return (self.autopilot.connected or self.simulation.time_ns > 0) and now_ns() >= self._due_ns

    def _await(self, is_ready: Callable[[], bool]) -> None:
        """Receive outputs until `is_ready` returns true."""
        began = now_ns()
        while True:
            # Polling costs as much as a step, so in lockstep this waits for the reply.
            wait_ns = self.autopilot.wait_limit_ns() if self.autopilot.lockstep else self._due_ns - now_ns()
            seconds = 0.0 if is_ready() else max(0, min(wait_ns, CHECK_NS)) / NS_PER_S
            readable = select.select([self.autopilot.fileno()], [], [], seconds)[0]
            outputs = self.autopilot.receive(now_ns()) if readable else None
            if outputs:
                self.motors.update(outputs)
                if self._sent_ns:
                    self.round_trip.add(outputs.received_ns - self._sent_ns)
                    self._sent_ns = 0
            now = now_ns()
            if now - self._checked_ns > CHECK_NS:  # also if no single wait is this long
                self._checked_ns = now
                self.autopilot.check(now)
                self._check_program(now - began)
            if is_ready():
                break
        # In lockstep no simulation time passes without new outputs, so the last outputs are used at any age.
        motors = self.motors
        pulses = (motors.latest if self.autopilot.lockstep else motors.at(now_ns())).pwm_us
        self.pwm_us = self.motors.map.neutral if self.ignores_outputs else pulses

    def _check_program(self, waited_ns: int) -> None:
        ended = self.program.ended() if self.program else None
        if ended:
            raise DeviceError(ended)
        if waited_ns > TIMEOUT_NS:
            raise DeviceError(
                f"{self.autopilot.name}: no outputs for {waited_ns / NS_PER_S:.0f} s: "
                "start the autopilot, or set its program in [autopilot] program"
            )
