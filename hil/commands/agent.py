"""`uuv-hil agent`: plan for one vehicle of a fleet, beside its neighbours' planners."""

from hil.commands.listening import add_wait
from hil.common.options import add_member, add_scenario, changes_of, new_parser
from hil.common.stop import StopSignals
from hil.master.agent import run
from hil.scenario.config import load_scenario

EXAMPLES = """\
Each vehicle of a fleet has its slave and its agent. The agents find each other at the endpoints that the
scenario names, and wait for the agents of all vehicles that start nearby. Ctrl-C ends it; the vehicle then stops.

examples:
  uuv-hil slave target_hunting --member uuv2 &
  uuv-hil agent target_hunting --member uuv2

All of them at once: uuv-hil case target_hunting --hil
"""


def main(arguments: list[str]) -> int:
    """Plan for the vehicle until stopped; return the exit code. Raises MissionError if something went wrong with it."""
    parser = new_parser("agent", __doc__, EXAMPLES)
    add_scenario(parser, None)
    add_member(parser)
    add_wait(parser, 60.0)
    options = parser.parse_args(arguments)
    scenario = load_scenario(options.scenario, changes_of(options))
    with StopSignals() as stop_fd:
        run(scenario, options.member, stop_fd, _report, options.wait)
    return 0


def _report(text: str) -> None:
    print(text, flush=True)
