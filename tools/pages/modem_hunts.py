"""Measure the effect of modems on the hunt in simulated time: the table of docs/explanation/modems.md.

python -m tools.pages.modem_hunts [SEEDS]           20 seeds take some minutes
"""

import argparse
import sys
from collections import Counter
from typing import Any

from hil.cases.hunt.simulated import SimulatedHunt
from hil.cases.hunt.watch import HuntOutcome, HuntWatch
from hil.scenario.config import load_scenario

SCENARIO = "target_hunting_acoustic"
# Light does not reach the far end of the line in such water. So no vehicle waits for messages from there, as in
# target_hunting.toml.
SHORT_RANGE = {"hunting.fields.comfortable": 4.0, "hunting.fields.communication_range": 5.0}
HUNTS: dict[str, dict[str, Any]] = {
    "sound, slots of 250 ms": {},
    "sound, at random, every 1 s": {"modem.slot": 0, "hunting.report_period": 1.0},
    "sound, at random, every 2 s": {"modem.slot": 0, "hunting.report_period": 2.0, "hunting.report_timeout": 8.0},
    "light, coast, slots of 50 ms": {"modem": {"kind": "optical", "slot": "50 ms", "attenuation": 0.4}},
    "light, harbour, slots of 50 ms": {
        "modem": {"kind": "optical", "slot": "50 ms", "attenuation": 2.2},
        **SHORT_RANGE,
    },
}
RESULTS = ("delivered", "collided", "deaf", "damaged", "too_weak")


def main() -> int:
    """Fly the hunts and print the table; return 0."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seeds", metavar="SEEDS", nargs="?", type=int, default=20, help="number of seeds [%(default)s]")
    seeds = range(1, parser.parse_args().seeds + 1)
    print(f"| modem | success | time s | least distance m | {' | '.join(RESULTS)} |")
    print("|---|" + "---|" * (3 + len(RESULTS)))
    for name, changes in HUNTS.items():
        flights = [hunt({"seed": seed, **changes}) for seed in seeds]
        print(row(name, [outcome for outcome, _ in flights], sum((counts for _, counts in flights), Counter())))
    return 0


def hunt(changes: dict[str, Any]) -> tuple[HuntOutcome, Counter[str]]:
    """Fly one hunt; return its outcome, and the number of messages by result."""
    scenario = load_scenario(SCENARIO, changes)
    watch = HuntWatch(scenario)
    simulated = SimulatedHunt(scenario, watch)
    simulated.run()
    assert simulated.channel
    return watch.outcome(), simulated.channel.counts


def row(name: str, outcomes: list[HuntOutcome], counts: Counter[str]) -> str:
    """Return a row of the table. Its shares are of all possible receptions: three for each sent message."""
    could = 3 * counts["sent"]
    shares = " | ".join(f"{100.0 * counts[result] / could:.1f} %" for result in RESULTS)
    succeeded = sum(outcome.success for outcome in outcomes)
    time = sum(outcome.duration for outcome in outcomes) / len(outcomes)
    least = min(outcome.judgement.separation for outcome in outcomes)
    return f"| {name} | {succeeded} of {len(outcomes)} | {time:.1f} | {least:.2f} | {shares} |"


if __name__ == "__main__":
    sys.exit(main())
