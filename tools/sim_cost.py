"""What one simulated vehicle costs: how much faster than real time it goes, and its share of a core in real time.

    python tools/sim_cost.py [--vehicle NAME]

With IMU, DVL and pressure sensor at their usual rates, every thruster running and every fin turned: at 100 Hz as fast
as it goes, with the C and without; at 400 Hz in real time. No network, no link. Run it while the machine is quiet.
"""

import argparse
import os
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))

from hil.common.clock import NS_PER_S, RateKeeper, now_ns
from sim.environment.world import load_world
from sim.native import SWITCH, choose
from sim.sensors.suite import fit
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle

SLOW_NS, QUICK_NS = 10_000_000, 2_500_000
ROUND_STEPS = 5000
REAL_TIME_S = 10.0


def new_simulation(name: str, step_ns: int) -> Simulation:
    """Return a vehicle at 5 m depth with the three sensors."""
    vehicle, _ = load_vehicle(name)
    suite = fit(odometry=None, ground_truth=None)
    return Simulation(vehicle, load_world("paper_field"), suite, 1, step_ns, (0.0, 0.0, 5.0))


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


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicle", default="bluerov2_heavy", help="preset or file [%(default)s]")
    parser.add_argument("--rounds", type=int, default=15, help=f"rounds of {ROUND_STEPS} steps [%(default)s]")
    options = parser.parse_args()
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
