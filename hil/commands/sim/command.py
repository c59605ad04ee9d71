"""`uuv-hil sim`: fly the mission of a scenario in one process, without network or link."""

import argparse
import sys
import time
from contextlib import ExitStack
from typing import Any

from hil.cases.simulated import SimulatedVehicle, Watch, fly, progress_watch
from hil.commands.view.flights import FlightViewer
from hil.common.clock import NS_PER_S, RateKeeper, now_ns, seconds_ns
from hil.common.errors import STOPPED
from hil.common.options import SEED, add_json, add_output, add_plot, add_scenario, add_view, changes_of, new_parser
from hil.common.streams import ProgressLine
from hil.common.text import json_text
from hil.master.flight import Outcome, Plan, prepare, require_success
from hil.plots import run_picture as picture
from hil.plots.plotting import check_picture
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
        from hil.commands.sim.autopilot import fly_autopilot

        return fly_autopilot(scenario, options)
    plan = prepare(scenario)
    vehicle = SimulatedVehicle(scenario, plan.world)
    simulation = vehicle.simulation
    warning = attitude_warning(scenario, simulation.vehicle)
    if warning:
        print(f"WARNING: {warning}", file=sys.stderr, flush=True)
    with ExitStack() as opened:
        if options.view:
            watches = [_show(opened, scenario, vehicle)]
        else:
            watches = [] if options.fast else [_pace(seconds_ns(scenario.slave.step))]
        return _fly(options, scenario, plan, vehicle, watches)


def _fly(
    options: argparse.Namespace, scenario: Scenario, plan: Plan, vehicle: SimulatedVehicle, watches: list[Watch]
) -> int:
    simulation = vehicle.simulation
    line = ProgressLine()
    watches.append(progress_watch(plan.planner, line.show))
    flight = None
    if options.output or options.plot:
        from hil.plots.force_log import Flight

        flight = Flight(simulation)
        watches.append(lambda vehicle: flight.record(vehicle.simulation))
    began, began_cpu = time.monotonic(), time.process_time()  # psutil's processor time has steps of 10 ms
    outcome = None
    try:
        outcome, digest = fly(scenario, plan, vehicle, watches)
        line.clear()
        took, cpu = time.monotonic() - began, time.process_time() - began_cpu
        print(_as_json(outcome, digest, took, cpu) if options.json else _as_text(outcome, digest, took, cpu))
    except KeyboardInterrupt:
        line.clear()
        print(f"interrupted after {simulation.time_ns / NS_PER_S:.1f} s")
    if flight and options.output:
        flight.write(options.output)
    if flight and options.plot:
        flight.draw(options.plot, lambda axes: _draw_field(axes, scenario, plan, outcome))
    if outcome is None:
        return STOPPED
    require_success(outcome)
    return 0


def _show(opened: ExitStack, scenario: Scenario, vehicle: SimulatedVehicle) -> Watch:
    """Show the flight in a browser; the view paces it."""
    return opened.enter_context(FlightViewer().show_simulated(scenario, {scenario.slave.node: vehicle}))


def _draw_field(axes: Any, scenario: Scenario, plan: Plan, outcome: Outcome | None) -> None:
    """Draw obstacles, path, goal and events."""
    picture.draw_world(axes, plan.world)
    picture.draw_path(axes, plan.planner.path)
    picture.draw_goal(axes, scenario)
    picture.draw_events(axes, outcome.events if outcome else ())


def _pace(step_ns: int) -> Watch:
    """Delay each step until it is due in real time."""
    schedule = RateKeeper(step_ns, now_ns())
    ahead = 0

    def wait(vehicle: SimulatedVehicle) -> None:
        nonlocal ahead
        ahead += 1
        while ahead > 0:
            time.sleep(max(0, schedule.deadline_ns - now_ns()) / NS_PER_S)
            ahead -= schedule.due(now_ns())

    return wait


def _as_text(outcome: Outcome, digest: str, duration: float, cpu: float) -> str:
    speed = f"{outcome.duration / duration:.3g} times real time, {cpu / duration:.1%} of a core"
    first = f"{outcome.verdict} after {outcome.duration:.1f} s simulated in {duration:.2f} s: {speed}"
    return "\n".join([first, outcome.summary, *outcome.event_lines, f"final state {digest}"])


def _as_json(outcome: Outcome, digest: str, duration: float, cpu: float) -> str:
    from hil.bench.table.hil_table import plain_outcome

    return json_text({**plain_outcome(outcome), "took_s": duration, "cpu_s": cpu, "final_state": digest})
