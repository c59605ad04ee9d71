"""`uuv-hil gateway json`: serve vehicles to MATLAB, Octave and whatever else can write lines of JSON to a socket."""

import os

import hil
from hil.commands.listening import add_fleet, add_take_over, connect_arguments, presence
from hil.common.options import add_serving, new_parser
from hil.common.stop import StopSignals, is_stopped
from hil.gateways.json_lines.server import JsonGateway

POLL_S = 0.5  # between two checks of which vehicles are connected
EXAMPLES = """\
examples:
  uuv-hil gateway json --connect tcp/192.168.3.116:7447
  uuv-hil gateway json --connect tcp/127.0.0.1:7447 --listen 127.0.0.1:7460
  printf '{"do": "get", "sensor": "state"}\\n' | nc 127.0.0.1 7450

A line is a request, {"id": 1, "vehicle": "uuv1", "do": "drive", "surge": 0.4}, and gets one line as its reply;
docs/how-to/matlab.md lists the requests. For MATLAB and Octave there is a package, +uuv, and a template of high-level
planning; `uuv-hil gateway json --matlab` prints their folder, for addpath. Anybody who reaches the port can read what
vehicles send. To command them, a client first sends {"do": "login", "token": "..."}. The token is new at each start;
it is printed, and stored in a file that only this user can read.
"""


def main(arguments: list[str]) -> int:
    """Serve until stopped; return the exit code."""
    parser = new_parser("gateway json", __doc__, EXAMPLES)
    add_fleet(parser)
    add_serving(parser, "127.0.0.1:7450")
    add_take_over(parser)
    parser.add_argument(
        "--matlab",
        action="store_true",
        help="print the folder of the package for MATLAB and Octave, +uuv, and of its template",
    )
    options = parser.parse_args(arguments)
    if options.matlab:
        print(os.path.join(os.path.dirname(os.path.abspath(hil.__file__)), "gateways", "matlab"))
        return 0
    _, (endpoints, routed, keys) = connect_arguments(options)
    host, port = options.listen
    with (
        StopSignals() as stop_fd,
        hil.connect(*endpoints, routed=routed, keys=keys, take_over=options.take_over) as fleet,
        JsonGateway(fleet, host, port) as gateway,
    ):
        print(f"lines of JSON at {host}:{gateway.port} for {', '.join(endpoints)}; Ctrl-C ends it")
        access = gateway.access
        print(f"token for commands: {access.token}" + (f" (in {access.path})" if access.path else ""), flush=True)
        names: list[str] | None = None
        while not is_stopped(stop_fd, POLL_S):
            if fleet.names != names:
                names = fleet.names
                print(presence(names, endpoints), flush=True)
    return 0
