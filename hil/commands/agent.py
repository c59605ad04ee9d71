"""`uuv-hil fleet agent`: plan for one vehicle of a fleet, beside its neighbours' planners."""

import argparse
from typing import Any

from hil.commands.listening import add_wait
from hil.common.options import add_member, add_scenario, changes_of
from hil.common.stop import StopSignals
from hil.scenario.config import load_scenario


def add_to(actions: Any) -> None:
    """Add the action to those of `uuv-hil fleet`."""
    parser = actions.add_parser("agent", help="plan for one vehicle, beside its neighbours' planners")
    add_scenario(parser, None)
    add_member(parser)
    add_wait(parser, 60.0)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    """Plan for the vehicle until stopped; return the exit code. Raises MissionError if something went wrong with it."""
    from hil.master.agent import run

    scenario = load_scenario(options.scenario, changes_of(options))
    with StopSignals() as stop_fd:
        run(scenario, options.member, stop_fd, _report, options.wait)
    return 0


def _report(text: str) -> None:
    print(text, flush=True)
