"""`uuv-hil gateway`: vehicles for MATLAB, Octave and whatever else can write lines of JSON to a socket."""

import os
import select

import hil
from hil.commands.parser import new_parser
from hil.errors import ConfigError
from hil.master.gateway import Gateway
from hil.stop import StopSignals

EXAMPLES = """\
examples:
  uuv-hil gateway --connect tcp/192.168.3.116:7447
  uuv-hil gateway --connect tcp/127.0.0.1:7447 --listen 127.0.0.1:7460
  printf '{"do": "get", "sensor": "state"}\\n' | nc 127.0.0.1 7450

A line is a request, {"id": 1, "vehicle": "uuv1", "do": "drive", "surge": 0.4}, and each has a line as its answer;
docs/python.md lists what can be done. For MATLAB and Octave there is a class, uuv_hil.m; `uuv-hil gateway --matlab`
says in which folder, for addpath. Whoever reaches the port can command the vehicles: leave it on this machine.
"""


def main(arguments: list[str]) -> int:
    """Serve until told to stop; the exit code."""
    parser = new_parser("gateway", __doc__, EXAMPLES)
    parser.add_argument("--connect", metavar="ENDPOINT", action="append", help="a slave, tcp/ADDRESS:PORT; or lan")
    parser.add_argument("--listen", metavar="HOST:PORT", default="127.0.0.1:7450", help="[%(default)s]")
    parser.add_argument("--routed", action="store_true", help="ENDPOINT is that of a router")
    parser.add_argument("--keys", metavar="FOLDER", default="", help="this machine's certificates")
    parser.add_argument("--take-over", action="store_true", help="command even if another master does already")
    parser.add_argument("--matlab", action="store_true", help="say where uuv_hil.m is")
    options = parser.parse_args(arguments)
    if options.matlab:
        print(os.path.join(os.path.dirname(os.path.abspath(hil.__file__)), "master", "matlab"))
        return 0
    host, _, port = options.listen.rpartition(":")
    if not options.connect or not host or not port.isdigit():
        raise ConfigError("gateway: give --connect tcp/ADDRESS:PORT, and --listen as HOST:PORT")
    with (
        StopSignals() as stop_fd,
        hil.connect(*options.connect, routed=options.routed, keys=options.keys, take_over=options.take_over) as fleet,
        Gateway(fleet, host, int(port)) as gateway,
    ):
        print(f"lines of JSON at {host}:{gateway.port} for {', '.join(options.connect)}; Ctrl-C ends it", flush=True)
        select.select((stop_fd,), (), ())
    return 0
