"""What watches a flight of `uuv-hil sim` after each step: its pace, the live view, and the log of its forces."""

import time
from argparse import Namespace
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from hil.commands.view.flights import FlightViewer
from hil.common.clock import NS_PER_S, RateKeeper, now_ns, seconds_ns
from hil.plots.force_log import DrawTrack, Flight
from hil.scenario.config import Scenario
from sim.simulation import Simulation

Watch = Callable[[Any], None]


def pace(options: Namespace, scenario: Scenario, vehicle: Any, opened: ExitStack) -> list[Watch]:
    """Return the watch that paces the flight: the live view, or real time; none if it is to be as fast as possible."""
    if options.view:
        return [opened.enter_context(FlightViewer().show_simulated(scenario, {scenario.slave.node: vehicle}))]
    return [] if options.fast else [_real_time(seconds_ns(scenario.slave.step))]


@contextmanager
def logged(options: Namespace, simulation: Simulation, watches: list[Watch], draw_track: DrawTrack) -> Iterator[None]:
    """Write and draw the forces of the flight inside, if --output or --plot ask for it. Raises ConfigError."""
    if not (options.output or options.plot):
        yield
        return
    flight = Flight(simulation)
    watches.append(lambda _: flight.record(simulation))
    yield
    if options.output:
        flight.write(options.output)
    if options.plot:
        flight.draw(options.plot, draw_track)


def _real_time(step_ns: int) -> Watch:
    """Delay each step until it is due in real time; catch up with late ones."""
    schedule: RateKeeper | None = None
    ahead = 0

    def wait(_: Any) -> None:
        nonlocal schedule, ahead
        schedule = schedule or RateKeeper(step_ns, now_ns())
        ahead += 1
        while ahead > 0:
            time.sleep(max(0, schedule.deadline_ns - now_ns()) / NS_PER_S)
            ahead -= schedule.due(now_ns())

    return wait
