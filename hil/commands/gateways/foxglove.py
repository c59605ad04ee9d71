"""`uuv-hil gateway foxglove`: show vehicles live in Foxglove, and command them from there."""

from contextlib import ExitStack
from typing import TYPE_CHECKING

import hil
from hil.commands.listening import add_connect, add_settings, is_routed, keys_of, network_of, scenario_and_endpoints
from hil.common.clock import now_ns, to_wall_ns
from hil.common.options import add_serving, new_parser
from hil.common.stop import StopSignals, is_stopped
from hil.gateways.commanding import Commanding
from hil.gateways.foxglove.layout import layout
from hil.gateways.foxglove.scene import encode_scene, scene_channel
from hil.recording.mcap_file import Message
from hil.recording.tap import Tap, save_resources
from hil.scenario.config import Scenario
from sim.environment.world import load_world
from sim.vehicle.vehicle import load_vehicle

if TYPE_CHECKING:
    from hil.gateways.foxglove.server import FoxgloveServer

EXAMPLES = """\
Open Foxglove, "open connection", "Foxglove WebSocket", and give the address that this command prints, with its token.
The messages are those of ROS 2, byte for byte. With --command the panels Teleop, Publish, Service Call and Parameters
command the vehicles; clients without the token can only read. Web pages need the token to read, too.
With a scenario the 3-D panel also shows its seabed, its obstacles and the vehicle.

examples:
  uuv-hil gateway foxglove --connect tcp/192.168.3.116:7447
  uuv-hil gateway foxglove --scenario mine.toml --command
  uuv-hil gateway foxglove --layout uuv1 > layout.json       a layout to import in Foxglove, of the usual sensors
  uuv-hil gateway foxglove --layout uuv1 --scenario mine.toml > layout.json   with its own sensors
  uuv-hil gateway foxglove --listen 0.0.0.0:9000             for other machines: programs that reach it can read
"""
LISTEN = "127.0.0.1:8765"
POLL_S = 0.02


def main(arguments: list[str]) -> int:
    """Show until stopped; return the exit code."""
    parser = new_parser("gateway foxglove", __doc__, EXAMPLES)
    add_connect(parser)
    add_settings(parser)
    add_serving(parser, LISTEN)
    parser.add_argument("--command", action="store_true", help="let clients with the token command the vehicles")
    parser.add_argument("--layout", metavar="VEHICLE", help="print a layout for Foxglove, and end")
    options = parser.parse_args(arguments)
    scenario, endpoints = scenario_and_endpoints(options)
    if options.layout:
        print(layout(options.layout, scenario))
        return 0
    from hil.gateways.foxglove.server import FoxgloveServer

    save_resources()
    with StopSignals() as stop_fd, ExitStack() as opened:
        commanding = None
        if options.command:
            keys, routed = keys_of(scenario), is_routed(scenario)
            commanding = Commanding(opened.enter_context(hil.connect(*endpoints, routed=routed, keys=keys)))
        host, port = options.listen
        tap = Tap(endpoints, *network_of(scenario))
        server = opened.enter_context(FoxgloveServer(host, port, commanding, tap.entities))
        opened.enter_context(tap)
        address = f"ws://{host}:{server.port}"
        print(f"{address}/?token={server.access.token} shows {', '.join(endpoints)}; Ctrl-C ends it", flush=True)
        print(f"waiting for a vehicle at {', '.join(endpoints)} (`uuv-hil slave` there)", flush=True)
        if scenario:
            _show_scene(server, scenario)
        nodes: set[str] = set()
        while not is_stopped(stop_fd, POLL_S):
            messages = tap.receive()
            server.show(messages)
            for message in messages:
                _report_vehicle(nodes, message)
            if text := tap.complaint():
                print(text, flush=True)
    return 0


def _report_vehicle(nodes: set[str], message: Message) -> None:
    """Report each vehicle once; /tf and /clock belong to no single vehicle."""
    node = message.topic.split("/")[1]
    if node not in nodes and message.topic.count("/") > 1:
        nodes.add(node)
        print(f"connected: {node}", flush=True)


def _show_scene(server: "FoxgloveServer", scenario: Scenario) -> None:
    scene = encode_scene(scenario, load_world(scenario.world), load_vehicle(scenario.vehicle)[0])
    server.publish(scene_channel(), to_wall_ns(now_ns()), scene, latched=True)
