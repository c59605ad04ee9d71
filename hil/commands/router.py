"""`uuv-hil router`: forward between vehicles and masters that cannot reach each other, or are many."""

from hil.commands.listening import add_settings, network_of
from hil.common.options import ENDPOINT, LOCAL_SLAVE, changes_of, new_parser
from hil.common.stop import StopSignals, is_stopped
from hil.network.roles import open_router_session
from hil.scenario.config import load_scenario

EXAMPLES = """\
Vehicles and masters then connect to the router; their scenario contains

  [network]
  mode = "routed"
  router = "tcp/192.168.3.1:7447"

examples:
  uuv-hil router --listen tcp/0.0.0.0:7447
  uuv-hil router --scenario mine.toml --listen tcp/0.0.0.0:7447     with the [network] and [security] of a scenario
  uuv-hil router --listen tcp/0.0.0.0:7447 --connect tcp/10.0.2.1:7447       joined with the router of another site
  uuv-hil master mine.toml --connect tcp/192.168.3.1:7447

Without a [security] section anyone who reaches the port can command.
"""


def main(arguments: list[str]) -> int:
    """Forward until SIGINT or SIGTERM; return the exit code."""
    parser = new_parser("router", __doc__, EXAMPLES)
    parser.add_argument(
        "--listen", metavar="ENDPOINT", type=ENDPOINT, default=LOCAL_SLAVE, help="endpoint to listen on [%(default)s]"
    )
    add_settings(parser)
    parser.add_argument(
        "--connect", metavar="ENDPOINT", type=ENDPOINT, action="append", default=[], help="another router; repeatable"
    )
    options = parser.parse_args(arguments)
    scenario = load_scenario(options.scenario, changes_of(options)) if options.scenario is not None else None
    network, security = network_of(scenario)
    others = tuple(options.connect)
    router = open_router_session(options.listen, network, security, others, lambda line: print(line, flush=True))
    with router as session, StopSignals() as stop_fd:
        print(f"forwarding between all peers that connect to {options.listen}", flush=True)
        reported: list[str] = []
        while not is_stopped(stop_fd, 0.5):
            connected = session.others()
            if connected != reported:
                reported = connected
                print(f"connected: {', '.join(reported) or 'none'}", flush=True)
    return 0
