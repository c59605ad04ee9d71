"""`uuv-hil sim`: the mission of a scenario in one process, without network or link."""

import sys
import time

from hil.cases.simulated import SimulatedVehicle, Watch, fly
from hil.clock import NS_PER_S, RateKeeper, now_ns, seconds_ns
from hil.commands.parser import new_parser
from hil.config import load_scenario
from hil.errors import STOPPED
from hil.master.flight import Outcome, prepare, require_success
from hil.master.planner import Planner

EXAMPLES = """\
Planner, controller, allocation, thrusters, dynamics and sensors are those of the real run; the same
scenario and seed give the same numbers to the last bit, in real time and with --fast.

examples:
  uuv-hil sim paper_field                       in real time; Ctrl-C ends it
  uuv-hil sim paper_field --fast                as fast as it goes
  uuv-hil sim mine.toml --fast --seed 7
  uuv-hil sim mine.toml --fast --plot flight.png --log flight.csv
"""
PROGRESS_PERIOD_S = 0.2


def main(arguments: list[str]) -> int:
    """Fly one mission in simulated time; the exit code."""
    parser = new_parser("sim", __doc__, EXAMPLES)
    parser.add_argument("scenario", metavar="SCENARIO", nargs="?", default="paper_field")
    parser.add_argument("--fast", action="store_true", help="as fast as it goes, instead of in real time")
    parser.add_argument("--seed", type=int, metavar="N", help="instead of the scenario's")
    parser.add_argument("--log", metavar="FILE.csv", help="write state, thrusts and every force, 20 times a second")
    parser.add_argument("--plot", metavar="FILE.png", help="draw the same")
    options = parser.parse_args(arguments)
    scenario = load_scenario(options.scenario)
    if options.seed is not None:
        scenario = scenario._replace(seed=options.seed)
    plan = prepare(scenario)
    vehicle = SimulatedVehicle(scenario, plan.world)
    simulation = vehicle.simulation
    watches: list[Watch] = [] if options.fast else [_pace(seconds_ns(scenario.slave.step))]
    if sys.stdout.isatty():
        watches.append(_show_progress(plan.planner))
    flight = None
    if options.log or options.plot:
        from hil.bench.flight import Flight

        flight = Flight(simulation)
        watches.append(lambda vehicle: flight.note(vehicle.simulation))
    began, began_cpu = time.monotonic(), time.process_time()
    outcome = None
    try:
        outcome, digest = fly(scenario, plan, vehicle, watches)
        _report(outcome, digest, time.monotonic() - began, time.process_time() - began_cpu)
    except KeyboardInterrupt:
        print(f"\ninterrupted after {simulation.time_ns / NS_PER_S:.1f} s")
    if flight and options.log:
        flight.write(options.log)
    if flight and options.plot:
        flight.draw(options.plot)
    if outcome is None:
        return STOPPED
    require_success(outcome)
    return 0


def _pace(step_ns: int) -> Watch:
    """Holds each step back until its time has come."""
    schedule = RateKeeper(step_ns, now_ns())
    ahead = 0

    def wait(vehicle: SimulatedVehicle) -> None:
        nonlocal ahead
        ahead += 1
        while ahead > 0:
            time.sleep(max(0, schedule.deadline_ns - now_ns()) / NS_PER_S)
            ahead -= schedule.due(now_ns())

    return wait


def _show_progress(planner: Planner) -> Watch:
    shown = 0.0

    def show(vehicle: SimulatedVehicle) -> None:
        nonlocal shown
        if time.monotonic() - shown > PROGRESS_PERIOD_S:
            shown = time.monotonic()
            print(f"\r{vehicle.time_ns / NS_PER_S:7.1f} s  {planner.progress:4.0%}", end="", flush=True)

    return show


def _report(outcome: Outcome, digest: str, took: float, cpu: float) -> None:
    if sys.stdout.isatty():
        print("\r\x1b[K", end="")
    print(
        f"{outcome.reason} after {outcome.duration:.1f} s simulated in {took:.2f} s: "
        f"{outcome.duration / took:.3g} times real time, {cpu / took:.1%} of a core"
    )
    print(outcome.summary)
    print(f"final state {digest}")
