"""`uuv-hil board`: install services after confirmation, and uninstall them."""

import argparse
import getpass
import os
import subprocess
import sys
from collections.abc import Sequence
from importlib import import_module

from boards import load_board
from boards.health import recognise
from boards.tree import Tree
from hil.commands.completion import find_parser
from hil.common.errors import ConfigError
from hil.common.streams import LOOK_FIRST, agreed
from hil.doctor.board import check_memory_limit
from hil.doctor.findings import Case, User, accounts
from hil.install import changes as board_changes
from hil.install import check as board_check
from hil.install import units as board_install
from hil.install.changes import Change
from hil.install.companions import KINDS, read_companions
from hil.install.units import MANAGER, NAME, Service

Command = tuple[str, ...]
RELOAD = ("systemctl", "daemon-reload")
# All devices that the rules are for: the rules apply to a "change" event as to an "add".
UDEV = [
    ("udevadm", "control", "--reload"),
    ("udevadm", "trigger", *(f"--subsystem-match={name}" for name in ("tty", "misc", "net", "usb", "usb-serial"))),
]
STATE_FOLDERS = ("/var/lib/uuv-hil", "/var/cache/uuv-hil")  # the unit's StateDirectory and CacheDirectory


def install(tree: Tree, options: argparse.Namespace) -> int:
    """Make the slave and others services; return the exit code. Raises HilError, and then nothing was changed."""
    user = options.user or os.environ.get("SUDO_USER") or getpass.getuser()
    check_user(tree, user)
    board = load_board(options.board) if options.board else recognise(tree)
    scenario = board_check.load_slave_scenario(options.scenario, options.listen, options.member, options.set)
    service = Service(scenario, options.scenario, user, options.listen, options.board, options.member, (*options.set,))
    companions = read_companions(options.service, scenario, service.scenario_words, find_parser)
    for package in [KINDS[one.name].package for one in companions if tree.live and KINDS[one.name].package]:
        import_module(package)  # if it is missing, the error names the extra
    service = service._replace(companions=companions)
    plan = board_changes.plan_install(tree, board_install.file_contents(tree, service, board))
    board_check.check(tree, service)
    for finding in check_memory_limit(Case(tree, board, scenario, User(user, 0, ()))):
        print(f"note: {finding.text} -> {finding.remedy}")
    for manual_step in (board_install.unknown_device(scenario), board_install.firewall_missing(tree, service)):
        if manual_step:
            print(f"note: {manual_step}")
    if not plan:
        print("everything is installed already")
        return 0
    before = _stop_commands(plan)
    enable = ("systemctl", "enable", *units([change for change in plan if change.after is not None]))
    after = [RELOAD, *([enable] if enable[2:] else []), *UDEV, *_reload_manager(plan)]
    if _confirm(tree, plan, [*before, *after], options):
        board_changes.check_permission(tree, plan)
        _run(tree, before)
        board_changes.apply_changes(tree, plan)
        _run(tree, after)
        names = " ".join(["uuv-hil", *(f"uuv-hil-{one.name}" for one in companions)])
        print(f"installed; start: sudo systemctl restart {names}, follow: journalctl -f -u 'uuv-hil*'")
    return 0


def uninstall(tree: Tree, options: argparse.Namespace) -> int:
    """Remove the files of install, with --service only the units of these; return the exit code. Raises HilError."""
    plan = board_changes.plan_uninstall(tree)
    if options.service:
        plan = _chosen(plan, options.service)
    before = _stop_commands(plan)
    after = [RELOAD, UDEV[0], *_reload_manager(plan)]
    if _confirm(tree, plan, [*before, *after], options):
        board_changes.check_permission(tree, plan)
        _run(tree, before)
        board_changes.apply_changes(tree, plan)
        _run(tree, after)
        print("uninstalled")
        left = [folder for folder in STATE_FOLDERS if tree.exists(folder) and not options.service]
        if left:
            print(f"files of the service are still there; remove them with: sudo rm -r {' '.join(left)}")
    return 0


ACTIONS = {"install": install, "uninstall": uninstall}


def _chosen(plan: Sequence[Change], names: Sequence[str]) -> list[Change]:
    """Return the removal of the units of the services `names`. Raises ConfigError if one of them is not installed."""
    wanted = [f"uuv-hil-{name}.service" for text in names for name in text.split(",")]
    if missing := [name for name in wanted if name not in units(plan)]:
        raise ConfigError(f"--service: {missing[0]} is not installed; there are {', '.join(units(plan))}")
    return [change for change in plan if os.path.basename(change.path) in wanted]


def units(changes: Sequence[Change]) -> list[str]:
    """Return the names of the changed units."""
    return [os.path.basename(change.path) for change in changes if change.path.endswith(".service")]


def check_user(tree: Tree, user: str) -> None:
    """Check that a user exists and is not root. Raises ConfigError."""
    if user in ("root", "0") or not NAME.fullmatch(user):
        raise ConfigError(
            f"--user: {user!r} is no valid user: name the user that the slave is to run as; it needs no root"
        )
    known = [row.name for row in accounts(tree, "/etc/passwd")]
    if known and user not in known:
        raise ConfigError(f"--user: there is no user {user!r} here; make one: sudo useradd --system -G dialout {user}")


def _stop_commands(changes: Sequence[Change]) -> list[Command]:
    """Return the commands that stop units before their files are removed, and clear systemd's list of failed units."""
    names = units([change for change in changes if change.after is None])
    return [("systemctl", "disable", "--now", *names), ("systemctl", "reset-failed", *names)] if names else []


def _reload_manager(plan: Sequence[Change]) -> list[Command]:
    """Return the command that makes NetworkManager, if it runs, reload its settings."""
    changed = any(change.path == MANAGER for change in plan)
    return [("systemctl", "try-reload-or-restart", "NetworkManager")] if changed else []


def _confirm(tree: Tree, plan: Sequence[Change], commands: list[Command], options: argparse.Namespace) -> bool:
    """Show all changes and commands, and ask; return whether the user agrees."""
    for change in plan:
        print(board_changes.to_diff(change), end="\n\n")
    for command in commands if tree.live else ():
        print("run", *command)
    if options.dry_run or options.yes:
        return not options.dry_run
    return agreed("make these changes?", LOOK_FIRST)


def _run(tree: Tree, commands: list[Command]) -> None:
    """Run commands on this machine; a failure is reported and does not stop the rest."""
    for command in commands if tree.live else ():
        if "reset-failed" in command:
            tree.run(*command)  # fails for a unit that has not failed, which is harmless
            continue
        try:
            status = f"exit code {subprocess.run(command, check=False).returncode}"
        except OSError as error:
            status = error.strerror or str(error)
        if status != "exit code 0":
            print(f"{' '.join(command)}: {status}", file=sys.stderr)
