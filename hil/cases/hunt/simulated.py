"""Simulate a hunt in one process: all vehicles and planners make their steps together.

Planners, messages and vehicles are those of HIL, but there is no network: reports arrive at once, or through the
simulated modems of the scenario.
"""

import time
from collections.abc import Callable

from hil.autonomy.control.controller import VelocityCommand
from hil.cases.energy import EnergyMeter
from hil.cases.hunt.watch import HuntRow, HuntWatch
from hil.cases.simulated import SimulatedVehicle
from hil.common.clock import NS_PER_S, seconds_ns
from hil.common.vectors import Vector3
from hil.master.flight import held
from hil.master.hunt import HuntPlanner
from hil.ros.fleet import FormationSample
from hil.scenario.config import Scenario
from hil.scenario.fleet import as_member, hunting_of
from hil.scenario.modem import TdmaSchedule, open_channel
from hil.scenario.modem_records import Modem
from sim.environment.world import load_world
from sim.modems.acoustic import AcousticChannel
from sim.sensors.samples import ODOMETRY


class SimulatedHunt:
    """Simulation of the members of a scenario, which passes rows to `watch`. Raises ConfigError, MissionError.

    `time`: simulation time, s. `planner_cpu_s`: processor time of all planners.
    """

    def __init__(self, scenario: Scenario, watch: HuntWatch) -> None:
        world = load_world(scenario.world)
        self.nodes = [member.node for member in scenario.member]
        self.vehicles = [SimulatedVehicle(as_member(scenario, node), world) for node in self.nodes]
        self.planners = [HuntPlanner(scenario, number) for number in range(len(self.nodes))]
        self.time = 0.0
        self.planner_cpu_s = 0.0
        self._watch = watch
        self._meters = [EnergyMeter(vehicle.simulation.vehicle) for vehicle in self.vehicles]
        self._command_ns = seconds_ns(scenario.master.command_period)
        self._report_ns = seconds_ns(hunting_of(scenario).report_period)
        self._command_due_ns, self._report_due_ns = self._command_ns, self._report_ns
        self.channel = open_channel(scenario) if scenario.modem else None
        self._modem = scenario.modem
        members = range(len(self.nodes)) if scenario.modem else ()
        self._schedules = [TdmaSchedule(scenario, number) for number in members]
        self._slots_ns = [schedule.after(0) for schedule in self._schedules]  # next slot of each member

    @property
    def energy(self) -> float:
        """Energy (J) that all thrusters have used."""
        return sum(meter.joules for meter in self._meters)

    def run(self, after_step: Callable[[SimulatedVehicle], None] = lambda _: None) -> None:
        """Run until the hunt is over; `after_step` is called with the first vehicle."""
        while not self._watch.reason:
            self.step()
            after_step(self.vehicles[0])

    def step(self) -> None:
        """Make one step of all vehicles, then send the commands and reports that are due."""
        for vehicle in self.vehicles:
            vehicle.step()
        now = self.vehicles[0].time_ns
        self.time = now / NS_PER_S
        if now >= self._command_due_ns:
            self._command_due_ns += self._command_ns
            self._command()
        if self._modem and self.channel:
            self._exchange_by_modem(self._modem, self.channel, now)
        elif now >= self._report_due_ns:
            self._report_due_ns += self._report_ns
            self._exchange()

    def _command(self) -> None:
        for vehicle, planner, meter in zip(self.vehicles, self.planners, self._meters, strict=True):
            began = time.thread_time()
            command = planner.command(self.time, vehicle.samples)
            self.planner_cpu_s += time.thread_time() - began
            assert isinstance(command, VelocityCommand)
            odometry = vehicle.samples[ODOMETRY]
            vehicle.command(held(command, odometry))
            vehicle.samples["formation"] = FormationSample(
                odometry.position, odometry.orientation, seconds_ns(planner.clock)
            )
            meter.add(self.time, vehicle.pwm_us)
        truths = [vehicle.simulation.truth() for vehicle in self.vehicles]
        for number, (vehicle, truth) in enumerate(zip(self.vehicles, truths, strict=True)):
            self._watch.observe(number, self.time, truth)
            self._watch.add_events(number, vehicle.simulation.events.events())
        positions = tuple([truth.position[:2] for truth in truths])
        self._watch.add_row(HuntRow(self.time, positions, tuple([planner.clock for planner in self.planners])))

    def _exchange(self) -> None:
        """Deliver the report of each vehicle to all others."""
        for sender, sending_planner in zip(self.nodes, self.planners, strict=True):
            report = sending_planner.report()
            for node, planner in zip(self.nodes, self.planners, strict=True):
                if report and node != sender:
                    planner.on_report(sender, report, self.time)

    def _exchange_by_modem(self, modem: Modem, channel: AcousticChannel, now: int) -> None:
        """Send the report of the vehicle whose slot has begun; deliver the messages that have arrived completely."""
        for number, due_ns in enumerate(self._slots_ns):
            if now >= due_ns:
                self._slots_ns[number] = self._schedules[number].after(now)
                if report := self.planners[number].modem_report():
                    channel.send(now, self.nodes[number], report, self._positions())
        for packet in channel.receive(now):
            sent_ns = packet.received_ns - modem.model.airtime_ns(len(packet.payload))
            planner = self.planners[self.nodes.index(packet.receiver)]
            planner.on_modem_report(packet.sender, packet.payload, sent_ns / NS_PER_S)

    def _positions(self) -> dict[str, Vector3]:
        """Return the true position of each vehicle by node."""
        return {node: v.simulation.truth().position for node, v in zip(self.nodes, self.vehicles, strict=True)}
