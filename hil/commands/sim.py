"""`uuv-hil sim`: the mission of a scenario in one process, without network or link."""

import sys
import time
from collections.abc import Callable

from hil.clock import NS_PER_S, RateKeeper, now_ns, seconds_ns
from hil.commands.parser import new_parser
from hil.config import Scenario, build_simulation, load_scenario
from hil.master.planner import Navigator, Outcome, Plan, prepare, require_success
from hil.slave.pilot import build_pilot
from sim.sensors.samples import ODOMETRY, OdometrySample
from sim.simulation import Simulation
from sim.vehicle import load_vehicle
from sim.world import load_world

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

# Called after each step with the simulation and the share of the path behind.
Watch = Callable[[Simulation, float], None]


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
    simulation = _new_simulation(scenario)
    watches: list[Watch] = [] if options.fast else [_pace(seconds_ns(scenario.slave.step))]
    if sys.stdout.isatty():
        watches.append(_show_progress())
    flight = None
    if options.log or options.plot:
        from hil.bench.flight import Flight

        flight = Flight(simulation)
        watches.append(lambda simulation, progress: flight.note(simulation))
    began, began_cpu = time.monotonic(), time.process_time()
    outcome = None
    try:
        outcome, digest = fly(scenario, plan, simulation, watches)
        _report(outcome, digest, time.monotonic() - began, time.process_time() - began_cpu)
    except KeyboardInterrupt:
        print(f"\ninterrupted after {simulation.time_ns / NS_PER_S:.1f} s")
    if flight and options.log:
        flight.write(options.log)
    if flight and options.plot:
        flight.draw(options.plot)
    if outcome is None:
        return 130
    require_success(outcome)
    return 0


def fly(
    scenario: Scenario, plan: Plan, simulation: Simulation | None = None, watches: list[Watch] | None = None
) -> tuple[Outcome, str]:
    """Fly the scenario's mission in simulated time; its outcome, and the exact final state as text.

    `simulation` is the scenario's at time 0, made here if left out. Raises ConfigError.
    """
    simulation = simulation or _new_simulation(scenario)
    _, control = load_vehicle(scenario.vehicle)
    pilot = build_pilot(scenario, simulation.vehicle, control, simulation.world)
    navigator = Navigator(scenario, plan)
    control_ns, command_ns = seconds_ns(scenario.slave.control_period), seconds_ns(scenario.master.command_period)
    pulses, _ = pilot.update(0, scenario.slave.control_period)
    control_due, command_due, reason = control_ns, command_ns, ""
    odometry: OdometrySample | None = None
    while not reason:
        for topic, sample in simulation.step(pulses.pwm_us):
            pilot.sense(topic, sample)
            if topic == ODOMETRY and isinstance(sample, OdometrySample):
                odometry = sample
        now = simulation.time_ns
        if now >= command_due and odometry is not None:
            command_due += command_ns
            pilot.command(navigator.command(odometry), now)
            reason = navigator.judge(now / NS_PER_S, simulation.truth())
        if now >= control_due:
            control_due += control_ns
            pulses, _ = pilot.update(now, scenario.slave.control_period)
        for watch in watches or ():
            watch(simulation, navigator.progress)
    return navigator.outcome(reason, simulation.time_ns / NS_PER_S, 0.0), _digest(simulation)


def _new_simulation(scenario: Scenario) -> Simulation:
    vehicle, _ = load_vehicle(scenario.vehicle)
    return build_simulation(scenario, vehicle, load_world(scenario.world))


def _pace(step_ns: int) -> Watch:
    """Holds each step back until its time has come."""
    schedule = RateKeeper(step_ns, now_ns())
    ahead = 0

    def wait(simulation: Simulation, progress: float) -> None:
        nonlocal ahead
        ahead += 1
        while ahead > 0:
            time.sleep(max(0, schedule.deadline_ns - now_ns()) / NS_PER_S)
            ahead -= schedule.due(now_ns())

    return wait


def _show_progress() -> Watch:
    shown = 0.0

    def show(simulation: Simulation, progress: float) -> None:
        nonlocal shown
        if time.monotonic() - shown > PROGRESS_PERIOD_S:
            shown = time.monotonic()
            print(f"\r{simulation.time_ns / NS_PER_S:7.1f} s  {progress:4.0%}", end="", flush=True)

    return show


def _report(outcome: Outcome, digest: str, took: float, cpu: float) -> None:
    if sys.stdout.isatty():
        print("\r\x1b[K", end="")
    print(
        f"{outcome.reason} after {outcome.duration:.1f} s simulated in {took:.2f} s: "
        f"{outcome.duration / took:.3g} times real time, {cpu / took:.1%} of a core"
    )
    print(
        f"{outcome.travelled:.1f} m travelled, {outcome.goal_error:.2f} m from the goal, at most "
        f"{outcome.cross_track_max:.2f} m off the path, at least {outcome.least_clearance:.2f} m from every obstacle"
    )
    print(f"final state {digest}")


def _digest(simulation: Simulation) -> str:
    truth = simulation.truth()
    return " ".join(value.hex() for value in (*truth.position, *truth.orientation, *truth.nu))
