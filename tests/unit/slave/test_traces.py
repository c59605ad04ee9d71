"""Traces of commands are published with the next sample, or soon; none is lost."""

import os
import select
from collections.abc import Iterator
from typing import Any, cast

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.common.clock import now_ns
from hil.ros.diagnostics import Diagnostics
from hil.scenario.config import load_scenario
from hil.slave.command_receiver import Received
from hil.slave.drivers.driver import open_driver
from hil.slave.loop import Loop
from hil.slave.pilot import build_pilot
from hil.slave.pilot_source import PilotSource, Trace
from sim.environment.world import load_world
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle
from tests.support.links.link_contract import PATIENCE_S

STEP_NS = 2_500_000


class CommandReceiver:
    """A command receiver that returns the commands put into it."""

    def __init__(self) -> None:
        self.waiting: list[Received] = []
        self.event = os.eventfd(0)

    def fileno(self) -> int:
        return self.event

    def take_latest(self) -> Received:
        return self.waiting.pop(0)


class SamplePublisher:
    """A publisher that records its output; `wanted` are the topics that have subscribers."""

    def __init__(self) -> None:
        self.output: list[str | Trace] = []
        self.wanted: tuple[str, ...] = ()

    def publish_sample(self, topic: str, sample: Any) -> bool:
        if topic in self.wanted:
            self.output.append(topic)
        return topic in self.wanted

    def publish_trace(self, trace: Trace) -> None:
        self.output.append(trace)

    def wake_publisher(self) -> None:
        """Do nothing: all samples have gone out already."""


class Bed:
    """A loop on a thruster link of its own, stepped by hand."""

    def __init__(self) -> None:
        scenario = load_scenario("paper_field")
        vehicle, control = load_vehicle(scenario.vehicle)
        world = load_world(scenario.world)
        simulation = Simulation(vehicle, world, dt_ns=STEP_NS, position=(0.0, 0.0, 5.0))
        pilot = build_pilot(scenario, vehicle, control, world)
        driver = open_driver("python", scenario.link, len(vehicle.channels), True, 1, print)
        self.command_receiver, self.sample_publisher = CommandReceiver(), SamplePublisher()
        receiver, publisher = cast(Any, self.command_receiver), cast(Any, self.sample_publisher)
        periods = 20_000_000, STEP_NS
        self.source = PilotSource(pilot, driver, receiver, *periods, publisher.publish_trace, print)
        self.loop = Loop(simulation, driver, self.source, publisher, STEP_NS, print)

    def run(self, steps: int) -> None:
        for _ in range(steps):
            self.loop.advance(1)

    def execute(self, sequence: int) -> None:
        """Deliver a command and the STM32's reply to it."""
        self.command_receiver.waiting.append(Received(VelocityCommand(surge=0.3), sequence, 7, now_ns()))
        self.loop.serve_source(now_ns())
        while self.source._awaited:
            assert select.select(self.loop.driver.descriptors, (), (), PATIENCE_S)[0], "it does not answer"
            self.loop.service_link(now_ns())

    def reported(self) -> list[int]:
        return [output.sequence for output in self.sample_publisher.output if isinstance(output, Trace)]


@pytest.fixture
def bed() -> Iterator[Bed]:
    bed = Bed()
    yield bed
    bed.loop.driver.close()
    os.close(bed.command_receiver.event)


def test_traces_are_published_with_the_next_sample(bed: Bed) -> None:
    bed.sample_publisher.wanted = ("odom",)
    bed.execute(1)
    bed.execute(2)
    assert bed.reported() == []
    bed.run(40)  # 0.1 s: odometry twice
    assert [output if isinstance(output, str) else output.sequence for output in bed.sample_publisher.output] == [
        "odom",
        1,
        2,
        "odom",
    ]
    bed.execute(3)
    bed.run(40)
    assert bed.reported() == [1, 2, 3]


def test_traces_are_published_after_50_ms_without_sample_subscribers(bed: Bed) -> None:
    bed.run(3)
    bed.execute(1)
    bed.run(19)
    assert bed.reported() == []
    bed.run(1)  # 50 ms after the answer
    assert bed.reported() == [1]


def test_the_last_trace_is_published_at_the_end(bed: Bed) -> None:
    bed.execute(1)
    stop = os.eventfd(1)
    bed.loop.run(stop)
    os.close(stop)
    assert bed.reported() == [1]


def test_the_figures_name_thrusters_that_fail_and_those_without_telemetry(bed: Bed) -> None:
    figures = Diagnostics()
    bed.source.add_figures(figures)
    names = [thruster.name for thruster in bed.loop.simulation.vehicle.thrusters]
    assert (figures.thrusters_failed, figures.thrusters_unwatched) == ("", ", ".join(names))
    pilot = bed.source.pilot
    pilot.watch_thrusters(lambda: [0.0] * len(names))
    pilot.set_command(VelocityCommand(heave=0.3), 0)
    for step in range(100):
        pilot.update(step, 0.02)
    bed.source.add_figures(figures)
    vertical = ", ".join(name for name in names if name.startswith("vertical"))
    assert (figures.thrusters_failed, figures.thrusters_unwatched) == (vertical, "")
    assert bed.source.problem().startswith(f"failed: {vertical}: ")
