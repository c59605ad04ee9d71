"""Measure the cost of one simulated vehicle: its speed beside real time, and its share of a core in real time.

    python tools/costs/sim_cost.py [--vehicle NAME]
    python tools/costs/sim_cost.py --table

With IMU, DVL and pressure sensor at their usual rates, every thruster running and every fin turned: at 100 Hz as fast
as it goes, with the C and without; at 400 Hz in real time. No network, no link. `--table` compares the step of vehicles
with fins, and of one in waves, with that of a BlueROV2, without sensors, by processor time: each integrator with the
same one, and Runge-Kutta with Verlet too. Run it while the machine is quiet.
"""

import argparse
import os
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from hil.common.clock import NS_PER_S, RateKeeper, now_ns
from sim.dynamics import Integrator
from sim.environment.ocean import Ocean, Waves
from sim.environment.world import World, load_world
from sim.native import SWITCH, choose
from sim.sensors.sensor_set import select_sensors
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle

SLOW_NS, QUICK_NS = 10_000_000, 2_500_000
ROUND_STEPS = 5000
REAL_TIME_S = 10.0
CALM = World("calm", "made up", (-1000.0, 1000.0, -1000.0, 1000.0), 50.0)
ROUGH = CALM._replace(ocean=Ocean(waves=Waves(significant_height=1.0, peak_period=6.0)))
BARE = select_sensors(imu=None, dvl=None, pressure=None, odometry=None, ground_truth=None)
# vehicle, world, depth in m, step; the others are compared with the first
CASES = [
    ("bluerov2", CALM, 5.0, QUICK_NS),
    *((name, CALM, 5.0, QUICK_NS) for name in ("remus100", "lauv", "eca_a9", "tethys")),
    ("bluerov2", ROUGH, 20.0, QUICK_NS),
    ("bluerov2", ROUGH, 10.0, SLOW_NS),
    ("bluerov2", ROUGH, 0.1, QUICK_NS),
    ("bluerov2", ROUGH, 0.1, SLOW_NS),
]
CASE_STEPS = 250


def new_simulation(name: str, step_ns: int) -> Simulation:
    """Return a vehicle at 5 m depth with the three sensors."""
    vehicle, _ = load_vehicle(name)
    sensors = select_sensors(odometry=None, ground_truth=None)
    return Simulation(vehicle, load_world("paper_field"), sensors, 1, step_ns, (0.0, 0.0, 5.0))


def step_seconds(name: str, rounds: int) -> float:
    """Return seconds a step at 100 Hz, of the best round."""
    simulation = new_simulation(name, SLOW_NS)
    pulses = (1550,) * len(simulation.vehicle.channels)
    best = float("inf")
    for _ in range(rounds):
        began = time.perf_counter()
        for _ in range(ROUND_STEPS):
            simulation.step(pulses)
        best = min(best, (time.perf_counter() - began) / ROUND_STEPS)
    return best


def real_time_share(name: str) -> float:
    """Return the share of a core that 400 Hz in real time takes."""
    simulation = new_simulation(name, QUICK_NS)
    pulses = (1550,) * len(simulation.vehicle.channels)
    began, cpu = now_ns(), time.process_time()
    schedule = RateKeeper(QUICK_NS, began)
    while simulation.time_ns < REAL_TIME_S * NS_PER_S:
        time.sleep(max(0, schedule.deadline_ns - now_ns()) / NS_PER_S)
        for _ in range(schedule.due(now_ns())):
            simulation.step(pulses)
    return (time.process_time() - cpu) * NS_PER_S / (now_ns() - began)


def case_seconds(case: tuple[str, World, float, int], integrator: Integrator) -> float:
    """Return seconds a step, of one round from rest."""
    name, world, depth, step_ns = case
    vehicle, _ = load_vehicle(name)
    simulation = Simulation(vehicle, world, BARE, 1, step_ns, (0.0, 0.0, depth), integrator=integrator)
    pulses = (1600,) * len(vehicle.channels)
    simulation.step(pulses)
    began = time.process_time()
    for _ in range(CASE_STEPS):
        simulation.step(pulses)
    return (time.process_time() - began) / CASE_STEPS


def print_table(rounds: int) -> None:
    """Print microseconds a step of every case and integrator, the best of rounds that take turns."""
    kinds: list[Integrator] = ["verlet", "rk4"]
    best = dict.fromkeys(((number, kind) for number in range(len(CASES)) for kind in kinds), float("inf"))
    for _ in range(rounds):
        for number, kind in best:
            best[number, kind] = min(best[number, kind], case_seconds(CASES[number], kind))
    print("| vehicle, depth, step rate | Verlet, µs | ratio | Runge-Kutta, µs | ratio | ratio to Verlet |")
    print("|---|---|---|---|---|---|")
    for number, (name, world, depth, step_ns) in enumerate(CASES):
        times = "".join(
            f" {best[number, kind] * 1e6:.2f} | {best[number, kind] / best[0, kind]:.1f} |" for kind in kinds
        )
        waves = " in waves" if world is ROUGH else ""
        crossed = f" {best[number, 'rk4'] / best[0, 'verlet']:.1f} |"
        print(f"| {name}{waves}, {depth:g} m deep, {NS_PER_S // step_ns} Hz |{times}{crossed}")


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicle", default="bluerov2_heavy", help="preset or file [%(default)s]")
    parser.add_argument("--rounds", type=int, default=15, help=f"rounds of {ROUND_STEPS} steps [%(default)s]")
    parser.add_argument("--table", action="store_true", help="the step of several vehicles, calm and in waves")
    options = parser.parse_args()
    if options.table:
        print_table(options.rounds)
        return 0
    print(f"{options.vehicle} with IMU, DVL and pressure sensor")
    for wish in ("", "0"):
        os.environ[SWITCH] = wish
        kind = "C" if choose()[0].__name__ == "NativeDynamics" else "Python"
        seconds = step_seconds(options.vehicle, options.rounds)
        factor = SLOW_NS / NS_PER_S / seconds
        print(f"100 Hz, {kind:7}{seconds * 1e6:7.2f} us a step{factor:7.0f} times real time")
    os.environ[SWITCH] = ""
    print(f"400 Hz in real time: {real_time_share(options.vehicle):.1%} of a core")
    return 0


if __name__ == "__main__":
    sys.exit(main())
