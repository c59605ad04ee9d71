"""`uuv-hil fleet`: start and stop the slaves of a fleet, here and on hosts over ssh; run its planners and modems."""

import argparse
import json
import os
import sys
from collections.abc import Callable
from typing import Any

from hil.commands.listening import add_wait, is_routed
from hil.common.children import module_command
from hil.common.clock import NS_PER_S, now_ns
from hil.common.columns import aligned
from hil.common.errors import ConfigError, DeviceError
from hil.common.options import (
    add_changes,
    add_json,
    add_member,
    add_scenario,
    add_scenario_name,
    changes_of,
    new_parser,
)
from hil.common.schema import find_preset
from hil.common.stop import StopSignals, is_stopped
from hil.common.tables import read_bytes
from hil.install import fleet
from hil.scenario.config import SCENARIOS, load_scenario
from hil.scenario.modem import modem_of

EXAMPLES = """\
Each [[member]] of the scenario becomes a slave with a log in ~/.cache/uuv-hil/fleet-NAME of its machine. They run
until `down`, also after this command has ended. A host is a name for `ssh`, with a key that needs no password. The
scenario's file is copied to it; vehicles and worlds that the scenario names by path must be there already.

Each slave needs its planner, `agent`. The agents find each other at the endpoints that the scenario names, and wait for
the agents of all vehicles that start nearby. Where the scenario has a [modem], they report by sound or light, and
`channel` simulates that: it receives the true positions of all vehicles, and delivers each message to the vehicles that
it reaches. Ctrl-C ends an agent, whose vehicle then stops, and the channel.
All of it at once on this machine: uuv-hil case target_hunting --hil

examples:
  uuv-hil fleet up mine.toml                                         all on this machine
  uuv-hil fleet up mine.toml --on uuv1=pi@192.168.3.116 --on uuv2=pi@192.168.3.117
  uuv-hil fleet status mine.toml
  uuv-hil fleet down mine.toml
  uuv-hil fleet agent mine.toml --member uuv2
  uuv-hil fleet channel mine.toml
"""
REPORT_PERIOD_S = 5.0


def main(arguments: list[str]) -> int:
    """Start, show or stop a fleet, or run its planners and modems; 3 if a slave does not run. Raises HilError."""
    options = _parser().parse_args(arguments)
    run: Callable[[argparse.Namespace], int] = options.run
    return run(options)


def _parser() -> argparse.ArgumentParser:
    parser = new_parser("fleet", __doc__, EXAMPLES)
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    up = actions.add_parser("up", help="start the slaves")
    up.add_argument("--on", metavar="NODE=HOST", action="append", default=[], help="where a member runs [here]")
    up.add_argument("--ssh", metavar="COMMAND", default=fleet.SSH, help="command that reaches hosts [%(default)s]")
    up.add_argument("--program", metavar="PATH", default="uuv-hil", help="this command on hosts [%(default)s]")
    up.set_defaults(run=_up)
    status = actions.add_parser("status", help="show the slaves; 3 if one does not run")
    status.set_defaults(run=_query)
    down = actions.add_parser("down", help="stop the slaves")
    down.set_defaults(run=_query)
    for slaves in (up, status, down):
        add_scenario_name(slaves, of="the fleet: ")
        add_json(slaves)
    add_changes(up)
    agent = actions.add_parser("agent", help="plan for one vehicle, beside its neighbours' planners")
    add_scenario(agent, None)
    add_member(agent)
    add_wait(agent, 60.0)
    agent.set_defaults(run=_plan)
    channel = actions.add_parser("channel", help="simulate the acoustic channel between the modems")
    add_scenario(channel, None)
    channel.set_defaults(run=_simulate_channel)
    return parser


def _up(options: argparse.Namespace) -> int:
    hosts = _hosts(options.scenario, options.on, changes_of(options))
    programs = {host: [options.program] for host in hosts.values()} | {"": module_command("hil")}
    path = os.path.abspath(load_scenario(options.scenario).path)
    changes = [word for change in options.set for word in ("--set", change)]
    text = read_bytes(path).decode("utf-8-sig")
    started = fleet.start(path, text, hosts, programs, options.ssh, changes)
    if options.json:
        print(json.dumps([one._asdict() for one in started]))
        return 0
    for one in started:
        print(f"{one.member}: started{f' on {one.host}' if one.host else ''}, process {one.pid}")
    return 0


def _query(options: argparse.Namespace) -> int:
    path = os.path.abspath(find_preset(SCENARIOS, options.scenario))
    members, ssh = fleet.load_started(path, options.scenario)
    if options.action == "down":
        states = fleet.stop(path, members, ssh)
        failed = [one for one in states if one.state == "unreachable"]
    else:
        states = fleet.query_states(members, ssh)
        failed = [one for one in states if one.state != "running"]
    if options.json:
        print(json.dumps([one._asdict() for one in states]))
    else:
        print(*aligned([(one.member, one.host or "here", one.state, one.last) for one in states]), sep="\n")
    if options.action == "down" and failed:
        names = ", ".join(one.member for one in failed)
        print(
            f"{names}: not stopped, still listed in {fleet.state_file(path)}: run `down` again, or remove that file",
            file=sys.stderr,
        )
    return DeviceError.exit_code if failed else 0


def _hosts(name: str, assignments: list[str], changes: dict[str, Any]) -> dict[str, str]:
    """Return member -> host. Raises ConfigError."""
    scenario = load_scenario(name, changes)
    if not scenario.member:
        raise ConfigError(
            f"{scenario.path}: has no [[member]], so it is not a fleet; start it with: uuv-hil slave {name}"
        )
    hosts = {member.node: "" for member in scenario.member}
    for assignment in assignments:
        node, equals, host = assignment.partition("=")
        if not equals or not host or host.startswith("-"):
            raise ConfigError(f"--on {assignment!r}: write NODE=HOST")
        if node not in hosts:
            raise ConfigError(f"--on {assignment!r}: no member {node!r}; there are {', '.join(hosts)}")
        hosts[node] = host
    return hosts


def _plan(options: argparse.Namespace) -> int:
    """Plan for one vehicle until stopped; return the exit code. Raises MissionError if something went wrong with it."""
    from hil.master.agent import run  # numpy, which actions on slaves do not need

    scenario = load_scenario(options.scenario, changes_of(options))
    with StopSignals() as stop_fd:
        run(scenario, options.member, stop_fd, _report, options.wait)
    return 0


def _simulate_channel(options: argparse.Namespace) -> int:
    """Simulate the channel until SIGINT or SIGTERM; return the exit code. Raises ConfigError, NetworkError."""
    from hil.master.acoustic_channel import ModemNetwork, summary  # the network, as above
    from hil.network.roles import open_master_session

    scenario = load_scenario(options.scenario, changes_of(options))
    if scenario.security:
        raise ConfigError(f"{scenario.path}: the simulated acoustic channel has no [security]: leave it out")
    modem = modem_of(scenario)
    endpoints = [endpoint for member in scenario.member for endpoint in (member.listen, member.agent)]
    if is_routed(scenario):
        endpoints = [scenario.network.router]
    began = now_ns()
    with StopSignals() as stop_fd, open_master_session(*endpoints, network=scenario.network) as session:
        network = ModemNetwork(session, scenario)
        _report(f"acoustic modems of {len(scenario.member)} vehicles, slots of {modem.slot:g} s")
        while not is_stopped(stop_fd, REPORT_PERIOD_S):
            _report(f"{(now_ns() - began) / NS_PER_S:7.1f} s  {summary(network.counts)}")
        _report(summary(network.counts))
    return 0


def _report(text: str) -> None:
    print(text, flush=True)
