"""`uuv-hil board`: which card computer this is, and the slave as a service of it."""

import argparse
import getpass
import json
import os
import subprocess
import sys

from boards import Board, load_board, model
from boards.health import Throttling, governors, recognise, temperature, throttling
from boards.tree import Tree, architecture
from hil.columns import aligned
from hil.commands import board_install
from hil.commands.board_install import Change, Service
from hil.commands.parser import new_parser
from hil.errors import ConfigError
from hil.schema import preset_names

Command = tuple[str, ...]
RELOAD = ("systemctl", "daemon-reload")
UDEV = [("udevadm", "control", "--reload"), ("udevadm", "trigger", "--subsystem-match=tty")]
EXAMPLES = """\
install writes a unit for systemd with a watchdog, rules for udev, limits for real-time scheduling, and for a
CAN link the unit that sets its bit rate. It shows every change first and asks; uninstall puts back what was there.

examples:
  uuv-hil board                                          what this machine is
  uuv-hil board list                                     all boards that are known
  uuv-hil board install mine.toml --user uuv --dry-run   only show it
  sudo .venv/bin/uuv-hil board install mine.toml --user uuv --listen tcp/0.0.0.0:7447
  sudo .venv/bin/uuv-hil board uninstall
"""


def main(arguments: list[str]) -> int:
    """Show the board, list all, install or uninstall the service; the exit code. Raises HilError."""
    options = _parser().parse_args(arguments)
    tree = Tree(options.root)
    if not os.path.isdir(options.root):
        raise ConfigError(f"--root: {options.root}: no such folder")
    if options.action == "install":
        return _install(tree, options)
    if options.action == "uninstall":
        return _uninstall(tree, options)
    if options.action == "list":
        print(listing())
        return 0
    here = load_board(options.board) if options.board else recognise(tree)
    print(json.dumps(to_json(tree, here)) if options.json else describe(tree, here))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = new_parser("board", __doc__, EXAMPLES)
    parser.add_argument("action", nargs="?", choices=("show", "list", "install", "uninstall"), default="show")
    parser.add_argument("scenario", metavar="SCENARIO", nargs="?", help="install: what the service is to run")
    parser.add_argument("--board", metavar="NAME", help="the card computer this is [recognised]")
    parser.add_argument("--root", metavar="PATH", default="/", help="where the machine's /proc, /sys, /etc are [/]")
    parser.add_argument("--json", action="store_true", help="show: for other programs")
    parser.add_argument("--user", metavar="NAME", help="install: who runs the slave [who called sudo]")
    parser.add_argument("--listen", metavar="ENDPOINT", help="install: where masters connect [the scenario's]")
    parser.add_argument("--dry-run", action="store_true", help="only show what would change")
    parser.add_argument("--yes", action="store_true", help="do not ask")
    return parser


def listing() -> str:
    """One line a board."""
    rows: list[tuple[str, ...]] = [("preset", "board", "processor", "serial port", "CAN")]
    for name in preset_names("boards"):
        board = load_board(name)
        can = board.can[0].controller.partition(",")[0] if board.can else "-"
        rows.append((name, board.name, board.cpu, board.uart or "-", can))
    return "\n".join(aligned(rows))


def describe(tree: Tree, board: Board | None) -> str:
    """What the machine is and how it does, as text for a terminal."""
    told = model(tree.root)
    if board is None:
        return f"none of the boards known: {told or 'nameless'}, {architecture(tree) or 'unknown architecture'}"
    rows = [
        ("processor", board.cpu),
        ("memory", _memory(tree, board)),
        ("wlan", board.wlan),
        ("temperature", _warmth(tree, board)),
        ("throttled", _throttled(throttling(tree, board))),
        ("governor", ", ".join(f"{name} ({count} processors)" for name, count in governors(tree).items())),
    ]
    parts = [f"{board.name}" + (f' (calls itself "{told}")' if told else "")]
    parts += aligned([(f"  {name}", text or "not told") for name, text in rows])
    for port in board.serial:
        parts.append(f"{port.device} {_there(tree, port.device)}: {port.at}" + _needs(port.needs))
    for bus in board.can:
        there = _there(tree, f"/sys/class/net/{bus.interface}")
        parts.append(f"{bus.interface} {there}: {bus.controller}" + _needs(bus.needs))
    for mode in board.power:
        watts = f", {mode.watts:g} W" if mode.watts else ""
        parts.append(f"power mode {mode.name}: {mode.cores} cores{watts} ({mode.command})")
    asked = board.recommended
    parts.append(
        f"recommended: step {asked.step * 1e3:g} ms, control_period {asked.control_period * 1e3:g} ms, at most "
        f"{asked.core_share:.0%} of a core and {asked.memory:g} MiB"
    )
    return "\n".join(parts)


def to_json(tree: Tree, board: Board | None) -> dict[str, object]:
    """The same as plain values."""
    slow = throttling(tree, board)
    return {
        "model": model(tree.root),
        "board": board.name if board else None,
        "profile": _plain(board) if board else None,
        "ports": {port.device: tree.exists(tree.resolve(port.device)) for port in board.serial} if board else {},
        "temperature": temperature(tree, board),
        "throttling": slow._asdict(),
        "governors": governors(tree),
    }


def _plain(value: object) -> object:
    """Records as dicts, however deep."""
    if isinstance(value, tuple):
        fields = getattr(value, "_asdict", None)
        return {key: _plain(item) for key, item in fields().items()} if fields else [_plain(item) for item in value]
    return value


def _memory(tree: Tree, board: Board) -> str:
    sold = ", ".join(f"{size / 1024:g}" for size in board.ram)
    _, _, after = tree.text("/proc/meminfo").partition("MemTotal:")
    here = after.split()[0] if after else ""
    texts = (f"sold with {sold} GiB" if sold else "", f"{int(here) / 2**20:.2f} GiB here" if here.isdigit() else "")
    return "; ".join(text for text in texts if text)


def _warmth(tree: Tree, board: Board) -> str:
    value = temperature(tree, board)
    limit = f", slows down from {board.throttles_at:g} °C" if board.throttles_at else ""
    return f"{value:.1f} °C{limit}" if value is not None else ""


def _throttled(slow: Throttling) -> str:
    before = f"since boot: {', '.join(slow.before)}" if slow.before else ""
    return "; ".join(filter(None, (", ".join(slow.now), before))) or "no"


def _there(tree: Tree, name: str) -> str:
    real = tree.resolve(name)
    if not tree.exists(real):
        return "(not there)"
    return f"({real})" if real != name and real.startswith("/dev/") else "(there)"


def _needs(text: str) -> str:
    return f"\n    needs {text}" if text else ""


def _install(tree: Tree, options: argparse.Namespace) -> int:
    from hil.config import load_scenario
    from hil.transport.settings import split

    if not options.scenario:
        raise ConfigError("board install: which scenario is the service to run? Give its file or name")
    if options.listen:
        split(options.listen)
    user = options.user or os.environ.get("SUDO_USER") or getpass.getuser()
    here = load_board(options.board) if options.board else recognise(tree)
    service = Service(load_scenario(options.scenario), options.scenario, user, options.listen, options.board)
    changes = board_install.plan_install(tree, service, here)
    if not changes:
        print("everything is installed as it should be")
        return 0
    enable = ("systemctl", "enable", *board_install.units([change for change in changes if change.after is not None]))
    after = [RELOAD, *([enable] if enable[2:] else []), *UDEV]
    if _agreed(tree, changes, after, options):
        board_install.install(tree, changes)
        _run(tree, after)
        print("installed; start it with: sudo systemctl start uuv-hil, follow it with: journalctl -fu uuv-hil")
    return 0


def _uninstall(tree: Tree, options: argparse.Namespace) -> int:
    changes, changed = board_install.plan_uninstall(tree)
    for path in changed:
        print(f"{path}: changed since it was written; it stays")
    names = board_install.units(changes)
    first = [("systemctl", "disable", "--now", *names)] if names else []
    if _agreed(tree, changes, [*first, RELOAD], options):
        board_install.check_permission(tree, [change.path for change in changes] + [board_install.MANIFEST])
        _run(tree, first)
        board_install.uninstall(tree, changes)
        _run(tree, [RELOAD])
        print("uninstalled")
    return 0


def _agreed(tree: Tree, changes: list[Change], commands: list[Command], options: argparse.Namespace) -> bool:
    """Show everything that will be done, and ask; whether it is wanted."""
    for change in changes:
        print(board_install.show(change), end="\n\n")
    for command in commands if tree.live else ():
        print("run", *command)
    if options.dry_run or options.yes:
        return not options.dry_run
    if not sys.stdin.isatty():
        raise ConfigError("nobody can be asked here: look at it with --dry-run, do it with --yes")
    return input("do this? [y/N] ").strip().lower() in ("y", "yes")


def _run(tree: Tree, commands: list[Command]) -> None:
    """On the machine itself only; what fails is said and does not stop the rest."""
    for command in commands if tree.live else ():
        try:
            done = subprocess.run(command, check=False)
        except OSError as error:
            print(f"{' '.join(command)}: {error.strerror}", file=sys.stderr)
            continue
        if done.returncode:
            print(f"{' '.join(command)}: exit code {done.returncode}", file=sys.stderr)
