"""`uuv-hil sim`: the same mission without network, link or clock, as fast as it goes."""

import sys
import time

from hil.clock import NS_PER_S, seconds_ns
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
scenario and seed give the same numbers to the last bit.

examples:
  uuv-hil sim paper_field
  uuv-hil sim mine.toml --seed 7
"""
PROGRESS_PERIOD_S = 0.2


def main(arguments: list[str]) -> int:
    """Fly one mission in simulated time; the exit code."""
    parser = new_parser("sim", __doc__, EXAMPLES)
    parser.add_argument("scenario", metavar="SCENARIO", nargs="?", default="paper_field")
    parser.add_argument("--seed", type=int, metavar="N", help="instead of the scenario's")
    options = parser.parse_args(arguments)
    scenario = load_scenario(options.scenario)
    if options.seed is not None:
        scenario = scenario._replace(seed=options.seed)
    plan = prepare(scenario)
    began = time.monotonic()
    outcome, digest = fly(scenario, plan, show=sys.stdout.isatty())
    took = time.monotonic() - began
    print(
        f"{outcome.reason} after {outcome.duration:.1f} s simulated in {took:.2f} s: "
        f"{outcome.duration / took:.0f} times real time"
    )
    print(
        f"{outcome.travelled:.1f} m travelled, {outcome.goal_error:.2f} m from the goal, at most "
        f"{outcome.cross_track_max:.2f} m off the path, at least {outcome.least_clearance:.2f} m from every obstacle"
    )
    print(f"final state {digest}")
    require_success(outcome)
    return 0


def fly(scenario: Scenario, plan: Plan, show: bool = False) -> tuple[Outcome, str]:
    """Fly the scenario's mission in simulated time; its outcome, and the exact final state as text.

    With `show` a line of progress renews itself. Raises ConfigError.
    """
    vehicle, control = load_vehicle(scenario.vehicle)
    world = load_world(scenario.world)
    simulation = build_simulation(scenario, vehicle, world)
    pilot = build_pilot(scenario, vehicle, control, world)
    navigator = Navigator(scenario, plan)
    control_ns, command_ns = seconds_ns(scenario.slave.control_period), seconds_ns(scenario.master.command_period)
    pulses, _ = pilot.update(0, scenario.slave.control_period)
    control_due, command_due, reason, shown = control_ns, command_ns, "", 0.0
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
        if show and time.monotonic() - shown > PROGRESS_PERIOD_S:
            shown = time.monotonic()
            print(f"\r{now / NS_PER_S:7.1f} s  {navigator.progress:4.0%}", end="", flush=True)
    if show:
        print("\r\x1b[K", end="")
    return navigator.outcome(reason, simulation.time_ns / NS_PER_S, 0.0), _digest(simulation)


def _digest(simulation: Simulation) -> str:
    truth = simulation.truth()
    return " ".join(value.hex() for value in (*truth.position, *truth.orientation, *truth.nu))
