"""`uuv-hil fleet channel`: simulate the channel between the modems of a fleet."""

import argparse
from typing import Any

from hil.commands.listening import is_routed
from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import ConfigError
from hil.common.options import add_scenario, changes_of
from hil.common.stop import StopSignals, is_stopped
from hil.scenario.config import load_scenario
from hil.scenario.modem import modem_of

REPORT_PERIOD_S = 5.0


def add_to(actions: Any) -> None:
    """Add the action to those of `uuv-hil fleet`."""
    parser = actions.add_parser("channel", help="simulate the acoustic or optical channel between the modems")
    add_scenario(parser, None)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    """Simulate the channel until SIGINT or SIGTERM; return the exit code. Raises ConfigError, NetworkError."""
    from hil.master.acoustic_channel import ModemNetwork, summary
    from hil.network.roles import open_master_session

    scenario = load_scenario(options.scenario, changes_of(options))
    if scenario.security:
        raise ConfigError(f"{scenario.path}: the simulated acoustic channel has no [security]: leave it out")
    modem = modem_of(scenario)
    routed = is_routed(scenario)
    endpoints = [endpoint for member in scenario.member for endpoint in (member.listen, member.agent)]
    began = now_ns()
    with (
        StopSignals() as stop_fd,
        open_master_session(*([scenario.network.router] if routed else endpoints), network=scenario.network) as session,
    ):
        network = ModemNetwork(session, scenario)
        print(f"{modem.kind} modems of {len(scenario.member)} vehicles, slots of {modem.slot:g} s", flush=True)
        while not is_stopped(stop_fd, REPORT_PERIOD_S):
            print(f"{(now_ns() - began) / NS_PER_S:7.1f} s  {summary(network.counts)}", flush=True)
        print(summary(network.counts), flush=True)
    return 0
