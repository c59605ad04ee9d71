"""`uuv-hil gateway ros1`: serve vehicles to a ROS 1 network (Noetic), and command them from there."""

import argparse
import re

from hil.commands.gateways.serving import serve_fleet
from hil.commands.listening import add_fleet, add_take_over
from hil.common.options import add_serving, new_parser
from hil.gateways.commanding import Commanding

EXAMPLES = """\
It runs a ROS 1 node at the master of ROS_MASTER_URI (`roscore`, not started here). The node publishes the topics of
vehicles in the types of Noetic, and their parameters. With --command it also subscribes to /NAME/cmd_vel and the other
command topics, serves the services, and sets parameters.

A ROS 1 network has no authentication: with --command every node of it commands. The node listens on this machine only,
unless --listen names an address; others reach it by ROS_HOSTNAME or ROS_IP, as with every node of ROS 1.

examples:
  uuv-hil gateway ros1 --connect tcp/192.168.3.116:7447
  uuv-hil gateway ros1 --scenario mine.toml --command
  uuv-hil gateway ros1 --listen 0.0.0.0:0                     nodes on other machines, too; 0 is any free port
"""
LISTEN = "127.0.0.1:0"


def main(arguments: list[str]) -> int:
    """Serve until stopped; return the exit code."""
    parser = new_parser("gateway ros1", __doc__, EXAMPLES)
    add_fleet(parser)
    add_serving(parser, LISTEN)
    add_take_over(parser)
    parser.add_argument("--command", action="store_true", help="let nodes of ROS 1 command the vehicles")
    parser.add_argument(
        "--name", metavar="NODE", type=_node_name, default="uuv_hil", help="name of the node [%(default)s]"
    )
    options = parser.parse_args(arguments)
    from hil.gateways.ros1.bridge import Ros1Bridge, master_uri

    master = master_uri()
    with (
        serve_fleet(options) as served,
        Ros1Bridge(options.name, options.listen, master, Commanding(served.fleet), options.command, _print) as bridge,
    ):
        _print(f"/{options.name} at {bridge.api} serves {', '.join(served.endpoints)} to {master}; Ctrl-C ends it")
        if options.command:
            _print("every node of that ROS network can command")
        served.forward(bridge.show, lambda: bool(bridge.ended))
        if bridge.ended:
            _print(f"ended: {bridge.ended}")
    return 0


def _node_name(text: str) -> str:
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,99}", text):
        raise argparse.ArgumentTypeError(f"expected letters, digits and _, a letter first, found {text[:60]!r}")
    return text


def _print(line: str) -> None:
    print(line, flush=True)
