"""`uuv-hil sim`: fly the mission of a scenario in one process, without network or link."""

import argparse
import sys
import time
from contextlib import ExitStack
from typing import Any

from hil.cases.simulated import SimulatedVehicle, fly, progress_watch
from hil.commands.sim.autopilot import fly_autopilot
from hil.commands.sim.watching import Watch, logged, pace
from hil.common.clock import NS_PER_S
from hil.common.errors import STOPPED
from hil.common.options import SEED, add_json, add_output, add_plot, add_scenario, add_view, changes_of, new_parser
from hil.common.streams import ProgressLine
from hil.common.text import json_text
from hil.master.flight import Outcome, Plan, prepare, require_success
from hil.master.guidance import narrow_turn
from hil.plots.plotting import check_picture
from hil.plots.run_picture import draw_flight
from hil.scenario.attitude_warning import attitude_warning
from hil.scenario.config import AUTOPILOTS, Scenario, load_single

EXAMPLES = """\
Planner, controller, allocation, thrusters, dynamics and sensors are those of the real run; the same
scenario and seed give the same numbers to the last bit, in real time and with --fast.

examples:
  uuv-hil sim paper_field                       in real time; Ctrl-C ends it
  uuv-hil sim paper_field --fast                as fast as it goes
  uuv-hil sim mine.toml --fast --seed 7
  uuv-hil sim mine.toml --fast --plot flight.png --output flight.csv
  uuv-hil sim mine.toml --view                  in a browser, with pause and speed
"""


def main(arguments: list[str]) -> int:
    """Fly one mission in simulated time; return the exit code."""
    parser = new_parser("sim", __doc__, EXAMPLES)
    add_scenario(parser)
    parser.add_argument("--fast", action="store_true", help="run as fast as possible instead of in real time")
    parser.add_argument("--seed", type=SEED, metavar="N", help="seed in place of the scenario's")
    add_output(parser, "FILE.csv", "state, thrusts and every force, 20 times a second")
    add_plot(parser, "draw state, thrusts and forces")
    add_json(parser)
    add_view(parser, "show it in a browser: pause, step, speed")
    options = parser.parse_args(arguments)
    if options.plot:
        check_picture(options.plot)
    scenario = load_single(options.scenario, changes_of(options))
    if options.seed is not None:
        scenario = scenario._replace(seed=options.seed)
    if scenario.controller in AUTOPILOTS:
        return fly_autopilot(scenario, options)
    plan = prepare(scenario)
    vehicle = SimulatedVehicle(scenario, plan.world)
    simulation = vehicle.simulation
    for warning in filter(None, (attitude_warning(scenario, simulation.vehicle), narrow_turn(plan.request))):
        print(f"WARNING: {warning}", file=sys.stderr, flush=True)
    with ExitStack() as opened:
        return _fly(options, scenario, plan, vehicle, pace(options, scenario, vehicle, opened))


def _fly(
    options: argparse.Namespace, scenario: Scenario, plan: Plan, vehicle: SimulatedVehicle, watches: list[Watch]
) -> int:
    simulation = vehicle.simulation
    line = ProgressLine()
    watches.append(progress_watch(plan.planner, line.show))
    began, began_cpu = time.monotonic(), time.process_time()  # psutil's processor time has steps of 10 ms
    outcome = None

    def draw_track(axes: Any, east: list[float], north: list[float]) -> None:
        draw_flight(axes, east, north, scenario, plan.world, plan, outcome.events if outcome else ())

    with logged(options, simulation, watches, draw_track):
        try:
            outcome, digest = fly(scenario, plan, vehicle, watches)
            line.clear()
            took, cpu = time.monotonic() - began, time.process_time() - began_cpu
            print(_as_json(outcome, digest, took, cpu) if options.json else _as_text(outcome, digest, took, cpu))
        except KeyboardInterrupt:
            line.clear()
            print(f"interrupted after {simulation.time_ns / NS_PER_S:.1f} s")
    if outcome is None:
        return STOPPED
    require_success(outcome)
    return 0


def _as_text(outcome: Outcome, digest: str, duration: float, cpu: float) -> str:
    speed = f"{outcome.duration / duration:.3g} times real time, {cpu / duration:.1%} of a core"
    first = f"{outcome.verdict} after {outcome.duration:.1f} s simulated in {duration:.2f} s: {speed}"
    return "\n".join([first, outcome.summary, *outcome.event_lines, f"final state {digest}"])


def _as_json(outcome: Outcome, digest: str, duration: float, cpu: float) -> str:
    return json_text({**outcome.as_plain(), "took_s": duration, "cpu_s": cpu, "final_state": digest})
