"""`uuv-hil channel`: simulate the channel between the modems of a fleet."""

from hil.commands.listening import is_routed
from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import ConfigError
from hil.common.options import add_scenario, changes_of, new_parser
from hil.common.stop import StopSignals, is_stopped
from hil.master.acoustic_channel import ModemNetwork, summary
from hil.network.roles import open_master_session
from hil.scenario.config import load_scenario
from hil.scenario.modem import modem_of

EXAMPLES = """\
The agents of a fleet whose scenario has a [modem] report by sound or light instead of the network. This process
simulates the modem channel: it receives the true positions of all vehicles, and delivers each message to the vehicles
that it reaches. It connects to all slaves and agents, on whatever machines they are. Ctrl-C ends it.

examples:
  uuv-hil slave target_hunting_acoustic --member uuv1 &      and so on, one a vehicle
  uuv-hil agent target_hunting_acoustic --member uuv1 &
  uuv-hil channel target_hunting_acoustic

All of them at once: uuv-hil case target_hunting_acoustic --hil
"""
REPORT_PERIOD_S = 5.0


def main(arguments: list[str]) -> int:
    """Simulate the channel until SIGINT or SIGTERM; return the exit code. Raises ConfigError, NetworkError."""
    parser = new_parser("channel", __doc__, EXAMPLES)
    add_scenario(parser, None)
    options = parser.parse_args(arguments)
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
