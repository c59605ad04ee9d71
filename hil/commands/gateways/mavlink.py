"""`uuv-hil gateway mavlink`: serve a vehicle to QGroundControl and other MAVLink software."""

import argparse
import os
from contextlib import ExitStack

from hil.client.client import VehicleClient
from hil.commands.listening import add_connect, add_take_over, network_of, presence, scenario_and_endpoints
from hil.common.options import add_scenario, checked, new_parser
from hil.common.stop import StopSignals
from hil.network.roles import open_master_session
from hil.scenario.mavlink_records import Mavlink, parse_endpoint

EXAMPLES = """\
An endpoint is udpout:HOST:PORT (a ground station), udpin:HOST:PORT or tcpin:HOST:PORT (several of them),
tcpout:HOST:PORT (a router), or serial:/dev/ttyUSB0:57600.

examples:
  uuv-hil gateway mavlink paper_field                          QGroundControl on this machine finds it by itself
  uuv-hil gateway mavlink --connect tcp/192.168.3.116:7447     a slave elsewhere
  uuv-hil gateway mavlink --endpoint udpin:0.0.0.0:14550 --commands-from network    from other machines too

Without --commands-from network, programs on other machines can only read. A section [mavlink] of the scenario has
the same settings, and more: docs/how-to/qgroundcontrol.md.
"""


def main(arguments: list[str]) -> int:
    """Serve until stopped; return the exit code."""
    if hasattr(os, "sched_setscheduler"):  # Linux: drop a priority inherited from a slave, whose loop is more urgent
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    options = _parser().parse_args(arguments)
    scenario, endpoints = scenario_and_endpoints(options)
    settings = (scenario.mavlink if scenario else None) or Mavlink()
    settings = settings._replace(endpoints=tuple(options.endpoint or settings.endpoints))
    settings = settings._replace(commands_from=options.commands_from or settings.commands_from)
    network, security = network_of(scenario)
    from hil.gateways.mavlink.assembly import defaults_of, motors_of, origin_of, parameter_file
    from hil.gateways.mavlink.gateway import Gateway, open_link
    from hil.gateways.mavlink.parameter_table import ParameterTable
    from hil.gateways.mavlink.protocols.signing import SigningKey
    from hil.gateways.mavlink.vehicle_port import NetworkVehicle

    with ExitStack() as stack:
        stop_fd = stack.enter_context(StopSignals())
        links = [open_link(text, _print) for text in settings.endpoints]
        session = stack.enter_context(open_master_session(*endpoints, network=network, security=security))
        node = options.vehicle or (scenario.slave.node if scenario else "uuv1")
        client = stack.enter_context(
            VehicleClient(
                session, node, rank=int(options.take_over), network=network, security=security, report=_print,
                topics=("odom",),
            )
        )  # fmt: skip
        port = stack.enter_context(NetworkVehicle(client, _print))
        stored = settings.parameters or parameter_file(node)
        table = ParameterTable(stored, port.parameters, port.set_parameter, defaults_of(scenario))
        signing = SigningKey(f"{stored}.key", settings.signing_key)
        for fault in table.faults:
            _print(fault)
        settings = settings._replace(system=int(table["SYSID_THISMAV"]))
        gateway = Gateway(
            port, settings, table, links, origin_of(scenario), _print, signing, motors=motors_of(scenario)
        )
        link_names = ", ".join([link.name for link in links])
        _print(f"MAVLink system {settings.system} is {node} at {', '.join(endpoints)}: {link_names}; Ctrl-C ends it")
        _print(presence([], endpoints))
        gateway.run(stop_fd)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = new_parser("gateway mavlink", __doc__, EXAMPLES)
    add_scenario(parser, None, optional=True)  # not --scenario: this command flies a vehicle
    add_connect(parser)
    parser.add_argument(
        "--endpoint",
        metavar="MAVLINK",
        type=checked(_endpoint),
        action="append",
        help="MAVLink endpoint; repeatable [udpout:127.0.0.1:14550, tcpin:127.0.0.1:5760]",
    )
    parser.add_argument("--vehicle", metavar="NAME", default="", help="vehicle [the scenario's, or uuv1]")
    parser.add_argument(
        "--commands-from", choices=("localhost", "network"), help="machines that may command [localhost]"
    )
    add_take_over(parser)
    return parser


def _endpoint(text: str) -> str:
    parse_endpoint(text)
    return text


def _print(line: str) -> None:
    print(line, flush=True)
