"""`uuv-hil fleet`: start, show and stop the slaves of a fleet, on this machine and on hosts over ssh."""

import json
import os
import sys
from typing import Any

from hil.common.children import module_command
from hil.common.columns import aligned
from hil.common.errors import ConfigError, DeviceError
from hil.common.options import add_changes, add_json, add_scenario_name, changes_of, new_parser
from hil.common.schema import find_preset
from hil.common.tables import read_bytes
from hil.install import fleet
from hil.scenario.config import SCENARIOS, load_scenario

EXAMPLES = """\
Each [[member]] of the scenario becomes a slave with a log in ~/.cache/uuv-hil/fleet-NAME of its machine. They run
until `down`, also after this command has ended. A host is a name for `ssh`, with a key that needs no password. The
scenario's file is copied to it; vehicles and worlds that the scenario names by path must be there already.

examples:
  uuv-hil fleet up mine.toml                                         all on this machine
  uuv-hil fleet up mine.toml --on uuv1=pi@192.168.3.116 --on uuv2=pi@192.168.3.117
  uuv-hil fleet status mine.toml
  uuv-hil fleet down mine.toml
"""


def main(arguments: list[str]) -> int:
    """Start, show or stop a fleet; 3 if `status` finds one that does not run. Raises HilError."""
    parser = new_parser("fleet", __doc__, EXAMPLES)
    parser.add_argument("action", choices=("up", "status", "down"), help="start, show or stop the slaves")
    add_scenario_name(parser, of="the fleet: ")
    parser.add_argument("--on", metavar="NODE=HOST", action="append", default=[], help="up: where a member runs [here]")
    parser.add_argument(
        "--ssh", metavar="COMMAND", default=fleet.SSH, help="up: command that reaches hosts [%(default)s]"
    )
    parser.add_argument("--program", metavar="PATH", default="uuv-hil", help="up: this command on hosts [%(default)s]")
    add_changes(parser)
    add_json(parser)
    options = parser.parse_args(arguments)
    if options.action == "up":
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
