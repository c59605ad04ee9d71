"""`uuv-hil instruments`: serve the instruments of a vehicle at their wires."""

import os
from contextlib import ExitStack

from hil.commands.listening import add_connect, own_endpoint
from hil.common.options import add_file, add_scenario, changes_of, new_parser
from hil.common.stop import StopSignals
from hil.network.roles import open_master_session
from hil.scenario.config import load_single

EXAMPLES = """\
A sensor with the key `instrument` in its section stands at its own wire, as the device that a vehicle's computer reads.
A slave starts this command itself, unless it has instruments = false in [slave].

examples:
  uuv-hil instruments mine.toml                                     for a slave on this machine
  uuv-hil instruments mine.toml --connect tcp/192.168.3.116:7447    for a slave elsewhere
"""


def main(arguments: list[str]) -> int:
    """Serve until stopped; return the exit code."""
    if hasattr(os, "sched_setscheduler"):  # Linux: drop a priority inherited from a slave, whose loop is more urgent
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    parser = new_parser("instruments", __doc__, EXAMPLES)
    add_scenario(parser, None)
    add_connect(parser)
    parser.add_argument("--vehicle", metavar="NAME", default="", help="vehicle [the scenario's]")
    add_file(parser, "--sent", metavar="FILE", help="file for a line a measurement: wire, bytes, its instant")
    options = parser.parse_args(arguments)
    scenario = load_single(options.scenario, changes_of(options))
    from hil.instruments.process import Instruments
    from hil.instruments.sent import SentFile

    with ExitStack() as stack:
        stop_fd = stack.enter_context(StopSignals())
        sent = stack.enter_context(SentFile(options.sent)).add if options.sent else None
        endpoints = options.connect or [own_endpoint(scenario)]
        session = stack.enter_context(
            open_master_session(*endpoints, network=scenario.network, security=scenario.security)
        )
        node = options.vehicle or scenario.slave.node
        serving = stack.enter_context(Instruments(scenario, session, node, _print, sent))
        _print(f"instruments of {node} at {', '.join(endpoints)}; Ctrl-C ends it")
        serving.run(stop_fd)
    return 0


def _print(line: str) -> None:
    print(line, flush=True)
