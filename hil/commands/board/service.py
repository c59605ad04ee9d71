"""`uuv-hil board install` and `uninstall`: show the changes, and make them after confirmation."""

import argparse
import getpass
import os
import subprocess
import sys
from collections.abc import Sequence

from boards import load_board
from boards.health import recognise
from boards.tree import Tree
from hil.common.errors import ConfigError
from hil.common.streams import LOOK_FIRST, agreed
from hil.doctor.board import check_memory_limit
from hil.doctor.findings import Case, User, accounts
from hil.install import changes as board_changes
from hil.install import check as board_check
from hil.install import units as board_install
from hil.install.changes import Plan
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
    """Make the slave a service; return the exit code. Raises HilError, and then nothing was changed."""
    if not options.scenario:
        raise ConfigError("install: which scenario is the service to run? Give its file or name")
    user = options.user or os.environ.get("SUDO_USER") or getpass.getuser()
    check_user(tree, user)
    board = load_board(options.board) if options.board else recognise(tree)
    scenario = board_check.load_slave_scenario(options.scenario, options.listen, options.member, options.set)
    service = Service(scenario, options.scenario, user, options.listen, options.board, options.member, (*options.set,))
    plan = board_changes.plan_install(tree, board_install.file_contents(tree, service, board))
    board_check.check(tree, service)
    for finding in check_memory_limit(Case(tree, board, scenario, User(user, 0, ()))):
        print(f"note: {finding.text} -> {finding.remedy}")
    for manual_step in (board_install.unknown_device(scenario), board_install.firewall_missing(tree, service)):
        if manual_step:
            print(f"note: {manual_step}")
    _print_changed(plan)
    if not plan.changes:
        print("everything is installed already")
        return 0
    before = _stop_commands([change.path for change in plan.removed])
    enable = ("systemctl", "enable", *units([change.path for change in plan.written]))
    after = [RELOAD, *([enable] if enable[2:] else []), *UDEV, *_reload_manager(plan)]
    if _confirm(tree, plan, [*before, *after], options):
        board_changes.check_permission(tree, plan)
        _run(tree, before)
        board_changes.apply_plan(tree, plan)
        _run(tree, after)
        print("installed; start it with: sudo systemctl restart uuv-hil, follow it with: journalctl -fu uuv-hil")
    return 0


def uninstall(tree: Tree, options: argparse.Namespace) -> int:
    """Restore the files from before install; return the exit code. Raises HilError, and then nothing was changed."""
    plan = board_changes.plan_uninstall(tree)
    _print_changed(plan)
    before = _stop_commands([*(change.path for change in plan.removed), *plan.changed])
    after = [RELOAD, UDEV[0], *_reload_manager(plan)]
    if _confirm(tree, plan, [*before, *after], options):
        board_changes.check_permission(tree, plan)
        _run(tree, before)
        board_changes.apply_plan(tree, plan)
        _run(tree, after)
        again = f"after that file is removed, uninstall again, which removes its record, {board_changes.MANIFEST}"
        print(f"uninstalled, except for changed files; {again}" if plan.changed else "uninstalled")
        left = [folder for folder in STATE_FOLDERS if tree.exists(folder)]
        if left:
            print(f"files of the service are still there; remove them with: sudo rm -r {' '.join(left)}")
    return 0


def units(paths: Sequence[str]) -> list[str]:
    """Return the names of the units among `paths`."""
    return [os.path.basename(path) for path in paths if path.endswith(".service")]


def check_user(tree: Tree, user: str) -> None:
    """Check that a user exists and is not root. Raises ConfigError."""
    if user in ("root", "0") or not NAME.fullmatch(user):
        raise ConfigError(
            f"--user: {user!r} is no valid user: name the user that the slave is to run as; it needs no root"
        )
    known = [row.name for row in accounts(tree, "/etc/passwd")]
    if known and user not in known:
        raise ConfigError(f"--user: there is no user {user!r} here; make one: sudo useradd --system -G dialout {user}")


def _print_changed(plan: Plan) -> None:
    for path in plan.changed:
        print(f"{path}: changed since it was written; it is left there; remove it with: sudo rm {path}")


def _stop_commands(paths: Sequence[str]) -> list[Command]:
    """Return the commands that stop units before their files are removed, and clear systemd's list of failed units."""
    names = units(paths)
    return [("systemctl", "disable", "--now", *names), ("systemctl", "reset-failed", *names)] if names else []


def _reload_manager(plan: Plan) -> list[Command]:
    """Return the command that makes NetworkManager, if it runs, reload its settings."""
    changed = any(change.path == MANAGER for change in plan.changes)
    return [("systemctl", "try-reload-or-restart", "NetworkManager")] if changed else []


def _confirm(tree: Tree, plan: Plan, commands: list[Command], options: argparse.Namespace) -> bool:
    """Show all changes and commands, and ask; return whether the user agrees."""
    for change in plan.changes:
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
            completed = subprocess.run(command, check=False)
        except OSError as error:
            print(f"{' '.join(command)}: {error.strerror}", file=sys.stderr)
            continue
        if completed.returncode:
            print(f"{' '.join(command)}: exit code {completed.returncode}", file=sys.stderr)
