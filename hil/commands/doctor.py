"""`uuv-hil doctor`: check whether this machine can run a scenario, and print remedies. It changes nothing."""

import argparse
import json
import os
import pwd
import re
from collections.abc import Callable, Iterator

from boards import load_board
from boards.health import recognise
from boards.tree import Tree
from hil.common.columns import fit_to_terminal
from hil.common.errors import ConfigError
from hil.common.options import add_board, add_json, add_listen, add_scenario, changes_of, new_parser
from hil.doctor import board as doctor_board
from hil.doctor import links as doctor_links
from hil.doctor import network as doctor_network
from hil.doctor import software as doctor_software
from hil.doctor.findings import Case, Finding, User, accounts
from hil.scenario.config import Scenario, load_scenario, with_port

EXAMPLES = """\
Each line is ok, a note, or a problem with its remedy. Without a scenario nothing is required, so that nothing is a
problem. The exit code is 1 if there is a problem, else 0.

examples:
  uuv-hil doctor                            on the single-board computer, before the first run
  uuv-hil doctor mine.toml                  everything that this scenario needs
  sudo uuv-hil doctor mine.toml --user uuv  for the user who will run it; only root sees open files of others
  uuv-hil doctor --root recorded/           a machine whose /proc, /sys, /dev and /etc were copied there
"""
Check = Callable[[Case], Iterator[Finding]]
SOFTWARE: tuple[Check, ...] = (doctor_software.check_packages, doctor_software.check_step)
MACHINE: tuple[Check, ...] = (
    doctor_board.check_machine,
    doctor_board.check_memory_limit,
    doctor_board.check_step_period,
    doctor_links.check_serial_port,
    doctor_links.check_console,
    doctor_links.check_port_users,
    doctor_links.check_speed,
    doctor_links.check_can_bus,
    doctor_board.check_governor,
    doctor_board.check_throttling,
    doctor_board.check_realtime_share,
    doctor_board.check_clock,
    doctor_network.check_network_ports,
    doctor_network.check_security,
    doctor_network.check_wlan,
)
INDENT = " " * 22  # of a finding's text, behind level and topic


def main(arguments: list[str]) -> int:
    """Print one line for each finding; return 1 if one of them is a problem, else 0. Raises HilError."""
    options = _parser().parse_args(arguments)
    tree = Tree(options.root)
    if not os.path.isdir(options.root):
        raise ConfigError(f"--root: {options.root}: no such folder")
    board = load_board(options.board) if options.board else recognise(tree)
    case = Case(tree, board, _scenario(options), find_user(tree, options.user))
    reported = []
    for finding in findings(case):
        reported.append(finding)
        if not options.json:
            print(fit_to_terminal(line(finding), INDENT), flush=True)
    if options.json:
        print(json.dumps([finding._asdict() for finding in reported]))
    return int(any(finding.level == "problem" for finding in reported))


def _parser() -> argparse.ArgumentParser:
    parser = new_parser("doctor", __doc__, EXAMPLES)
    add_scenario(parser, None, optional=True)
    add_board(parser)
    add_listen(parser)
    parser.add_argument("--port", metavar="ADDRESS", help="address of the thruster link [the scenario's]")
    parser.add_argument("--user", metavar="NAME", help="user that runs the slave [you]")
    parser.add_argument(
        "--root", metavar="PATH", default="/", help="folder that holds the machine's /proc and /sys [/]"
    )
    add_json(parser)
    return parser


def findings(case: Case) -> Iterator[Finding]:
    """Yield all findings; the permissions of this process are tried only if the tree is this machine's."""
    checks = (*SOFTWARE, *MACHINE, doctor_software.check_scheduling) if case.tree.live else MACHINE
    for check in checks:
        yield from check(case)


def line(finding: Finding) -> str:
    """Return a finding as one line of printable text, whatever the machine's files or names of processes contain."""
    remedy = f" -> {finding.remedy}" if finding.remedy else ""
    text = f"{finding.level:7}  {finding.topic:12} {finding.text}{remedy}"
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def find_user(tree: Tree, name: str | None) -> User:
    """Return the machine's user called `name`, by default this process's. Raises ConfigError if there is none."""
    if not tree.live:
        return _recorded_user(tree, name)
    if name is None:
        uid = os.getuid()
        known = {entry.pw_uid: entry.pw_name for entry in pwd.getpwall()}
        return User(known.get(uid, str(uid)), uid, (os.getgid(), *os.getgroups()))
    try:
        entry = pwd.getpwnam(name)
    except KeyError:
        raise ConfigError(f"--user: there is no user {name!r} on this machine") from None
    return User(name, entry.pw_uid, tuple(os.getgrouplist(name, entry.pw_gid)))


def _recorded_user(tree: Tree, name: str | None) -> User:
    """Return a user of a recorded machine from its files, by default the one with this process's user id."""
    for row in accounts(tree, "/etc/passwd"):
        if row.name == name or (name is None and row.number == os.getuid()):
            joined = [group.number for group in accounts(tree, "/etc/group") if row.name in group.fourth.split(",")]
            return User(row.name, row.number, (*map(int, re.findall("^[0-9]{1,10}$", row.fourth)), *joined))
    if name is None:
        return User(str(os.getuid()), os.getuid(), ())
    raise ConfigError(f"--user: there is no user {name!r} in {tree.path('/etc/passwd')}")


def _scenario(options: argparse.Namespace) -> Scenario | None:
    if options.scenario is None:
        if options.listen or options.port or options.set:
            raise ConfigError("--listen, --port and --set need a scenario")
        return None
    scenario = load_scenario(options.scenario, changes_of(options))
    if options.listen:
        scenario = scenario._replace(slave=scenario.slave._replace(listen=options.listen))
    return with_port(scenario, options.port) if options.port else scenario
