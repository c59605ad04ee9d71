"""`uuv-hil gateway ros2`: vehicles for ROS 2 nodes with FastDDS, Cyclone or another middleware."""

import os
from functools import partial

from hil.commands.listening import add_connect, add_settings, network_of, presence, scenario_and_endpoints
from hil.common.options import new_parser
from hil.common.stop import StopSignals
from hil.gateways.ros2.bridge import Ros2Bridge
from hil.gateways.ros2.interfaces import import_rclpy
from hil.network.roles import client_opener
from hil.ros import dialect

EXAMPLES = """\
Nodes with rmw_zenoh_cpp need no bridge. For all others this command is a node of ROS 2, in the environment of its
setup.bash. It mirrors the vehicles' nodes, with their topics, services and parameters. A topic is received only while a
node subscribes to it. With --command, nodes also command the vehicles, call all services and set parameters.

A ROS network has no authentication: with --command every node of it commands. Only nodes on this machine find the
bridge, unless --range or the variable ROS_AUTOMATIC_DISCOVERY_RANGE says otherwise.

examples:
  source /opt/ros/jazzy/setup.bash
  uuv-hil gateway ros2 --connect tcp/192.168.3.116:7447
  uuv-hil gateway ros2 --scenario mine.toml --command
  uuv-hil gateway ros2 --command --range subnet               nodes on other machines, too
"""
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
ONLY_LOCAL = "ROS_LOCALHOST_ONLY"  # Humble's, which later releases prefer with a warning


def main(arguments: list[str]) -> int:
    """Serve until stopped; return the exit code."""
    parser = new_parser("gateway ros2", __doc__, EXAMPLES)
    add_connect(parser)
    add_settings(parser)
    parser.add_argument("--command", action="store_true", help="let nodes of ROS command the vehicles")
    about = "machines whose nodes find the bridge [the environment's, else localhost]"
    parser.add_argument("--range", choices=("localhost", "subnet"), help=about)
    options = parser.parse_args(arguments)
    scenario, endpoints = scenario_and_endpoints(options)
    dialect.domain()  # a wrong one is an error now
    _limit_discovery(options.range)
    rclpy = import_rclpy()
    openers = [client_opener(endpoint, *network_of(scenario)) for endpoint in endpoints]
    with StopSignals() as stop_fd, Ros2Bridge(rclpy, openers, options.command, partial(print, flush=True)) as bridge:
        who = "every node of that ROS network can command; " if options.command else ""
        print(f"ROS 2 has what is at {', '.join(endpoints)}; {who}Ctrl-C ends it", flush=True)
        bridge.run(stop_fd, lambda names: print(presence(names, endpoints), flush=True))
    return 0


def _limit_discovery(chosen: str | None) -> None:
    """Let rclpy find and be found by nodes on these machines."""
    is_humble = os.environ.get("ROS_DISTRO") == "humble"
    if chosen or not {RANGE, ONLY_LOCAL} & os.environ.keys():
        name = ONLY_LOCAL if is_humble else RANGE
        os.environ.pop(ONLY_LOCAL, None)
        os.environ[name] = str(int(chosen != "subnet")) if is_humble else (chosen or "localhost").upper()
