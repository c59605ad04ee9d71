"""Events that the slave's loop records: contacts to the step, tilt, depth, and its thruster link."""

from math import pi

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.common.clock import now_ns, to_wall_ns
from hil.ros.commands import PoseCommand
from hil.ros.diagnostics import Diagnostics
from hil.slave.run_watch import RunWatch
from hil.slave.setpoints import PoseSetpoint
from sim.run_events import PERIOD_NS
from sim.simulation import Simulation
from tests.support.flights.flying import VEHICLE, WORLD, Bench

STILL = (1500,) * 6


class Driver:
    """A link that can be lost, and an STM32 that can stop answering."""

    losses = 0
    lost = is_silent = False


class Watched(Bench):
    """The vehicle in the pool with its watch, which is checked as the loop does."""

    def __init__(self) -> None:
        super().__init__()
        self.driver, self.output = Driver(), list[str]()
        self.watch = RunWatch(self.simulation, self.driver, self.pilot, self.output.append)  # type: ignore[arg-type]

    def run(self, seconds: float, pulses: tuple[int, ...] = STILL) -> list[str]:
        """Return the kinds of events so far."""
        for _ in range(round(400 * seconds)):
            self.simulation.step(pulses)
            if self.simulation.time_ns >= self.watch.due_ns:
                self.watch.check()
        return [event.kind for event in self.simulation.events.events()]


@pytest.fixture
def watched() -> Watched:
    return Watched()


def test_a_vehicle_at_rest_gives_no_events(watched: Watched) -> None:
    assert watched.run(2.0) == []
    assert watched.output == []


def test_a_lost_link_is_one_event_until_it_is_back(watched: Watched) -> None:
    watched.driver.lost, watched.driver.losses = True, 1
    watched.run(3.0)
    watched.driver.lost = False
    assert watched.run(3.0) == ["link_lost"]
    (event,) = watched.simulation.events.events()
    assert event.duration_ns == pytest.approx(3e9, abs=2 * PERIOD_NS)
    assert watched.output == ["link lost: the thruster link, at N 4.0 E 4.0 depth 2.0 m"]
    figures, before = Diagnostics(), to_wall_ns(now_ns()) - watched.simulation.time_ns
    watched.watch.add_figures(figures)
    (listed,) = figures.run_event_list or ()
    assert before <= listed.start_ns - event.start_ns <= to_wall_ns(now_ns()) - watched.simulation.time_ns


def test_a_loss_between_two_checks_is_recorded(watched: Watched) -> None:
    watched.run(1.0)
    watched.driver.losses += 1
    assert watched.run(1.0) == ["link_lost"]


def test_a_silent_stm32_is_an_event(watched: Watched) -> None:
    watched.driver.is_silent = True
    watched.run(0.5)
    assert watched.simulation.events.events()[0].what == "the STM32 does not answer"


def test_a_vehicle_upside_down_has_capsized(watched: Watched) -> None:
    watched.simulation.state.quaternion = [0.0, 1.0, 0.0, 0.0]
    assert watched.run(0.1) == ["capsize"]


def test_a_contact_between_two_checks_is_recorded(watched: Watched) -> None:
    """Contacts are recorded by the step, and reported at the next check."""
    watched.simulation.state.position = [4.0, 4.0, WORLD.depth - 0.5 * VEHICLE.dimensions[2] - 1e-4]
    watched.simulation.state.nu = [0.0, 0.0, 0.3, 0.0, 0.0, 0.0]
    assert watched.run(0.5) == ["collision"]
    assert watched.output[0].startswith("collision with the seabed, at N 4.0 E 4.0 depth ")


def test_depth_is_judged_only_where_one_is_commanded(watched: Watched) -> None:
    def drift_up() -> list[str]:
        watched.simulation.state.position = [4.0, 4.0, 2.0]
        watched.run(0.1)
        watched.simulation.state.position = [4.0, 4.0, 0.05]
        return watched.run(0.1)

    assert drift_up() == [], "no master commands it"
    for command in (VelocityCommand(surge=0.5), VelocityCommand(heave=-0.5)):
        watched.pilot.set_command(command, watched.simulation.time_ns)
        assert drift_up() == [], "it is moved by velocities"


@pytest.mark.parametrize("command", [VelocityCommand(depth=2.0), PoseSetpoint(PoseCommand((4.0, 4.0, 2.0), pi))])
def test_a_vehicle_commanded_to_depth_that_rises_has_surfaced(
    watched: Watched, command: VelocityCommand | PoseSetpoint
) -> None:
    watched.pilot.set_command(command, watched.simulation.time_ns)
    for share, events in ((2.0, []), (0.6, []), (0.3, ["surfaced"])):  # of its height
        watched.simulation.state.position = [4.0, 4.0, share * VEHICLE.dimensions[2]]
        assert watched.run(0.1) == events


def test_the_vehicle_file_sets_the_tilt_that_counts_as_capsized() -> None:
    lenient = Simulation(VEHICLE._replace(capsize_tilt=pi), WORLD, {}, position=(4.0, 4.0, 2.0))
    lenient.state.quaternion = [0.0, 1.0, 0.0, 0.0]
    watch = RunWatch(lenient, Driver(), Bench().pilot, print)  # type: ignore[arg-type]
    watch.check()
    assert len(lenient.events) == 0
