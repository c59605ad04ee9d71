"""`uuv-hil board`: identify this single-board computer; install the slave, and what runs beside it, as services."""

import argparse
import json
import os

from boards import Board, load_board, model
from boards.health import Throttling, governors, recognise, temperature, throttling
from boards.resources import total_memory_mib
from boards.tree import Tree, architecture
from hil.commands.board import service
from hil.common.columns import aligned, paragraph
from hil.common.errors import ConfigError
from hil.common.options import add_board, add_json, add_listen, add_member, add_scenario, new_parser
from hil.common.schema import preset_names

EXAMPLES = """\
install checks that the slave would start as the user. It then writes a systemd unit with a watchdog, udev rules, and
limits for real-time scheduling; for a CAN link also a unit that sets the bit rate; with NetworkManager also a setting
against power saving of the wlan. It shows every change and asks first; uninstall removes what it wrote.
--service adds services that run beside the slave: mavlink, record, view, foxglove, rosbridge, ros1, json, metrics
(`top --prometheus`) and router; in quotes, options of the command may follow the name. A later install removes the
services that it does not name.

examples:
  uuv-hil board show                                     identify this machine
  uuv-hil board list                                     list all known boards
  uuv-hil board install mine.toml --user uuv --dry-run   only show the changes
  sudo .venv/bin/uuv-hil board install mine.toml --user uuv --listen tcp/0.0.0.0:7447
  sudo .venv/bin/uuv-hil board install mine.toml --user uuv --service mavlink,record
  sudo .venv/bin/uuv-hil board install mine.toml --user uuv --service "view --listen 0.0.0.0:7480"
  sudo .venv/bin/uuv-hil board uninstall --service view  without --service, all
"""


def main(arguments: list[str]) -> int:
    """Show the board, list all, install or uninstall the service; return the exit code. Raises HilError."""
    if not arguments or (arguments[0].startswith("-") and arguments[0] not in ("-h", "--help")):
        arguments = ["show", *arguments]
    options = _parser().parse_args(arguments)
    if options.action == "list":
        print(listing())
        return 0
    tree = Tree(options.root)
    if not os.path.isdir(options.root):
        raise ConfigError(f"--root: {options.root}: no such folder")
    if options.action in service.ACTIONS:
        return service.ACTIONS[options.action](tree, options)
    board = load_board(options.board) if options.board else recognise(tree)
    if options.json:
        print(json.dumps(to_json(tree, board)))
    else:
        print(describe(tree, board))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = new_parser("board", __doc__, EXAMPLES)
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    show = actions.add_parser("show", help="identify this machine; the action without a word")
    add_board(show)
    add_json(show)
    actions.add_parser("list", help="list all known boards")
    install = actions.add_parser("install", help="make the slave, and what runs beside it, services")
    add_scenario(install, None)
    add_board(install)
    add_listen(install)
    add_member(install)
    install.add_argument("--user", metavar="NAME", help="user that runs the slave [the one who called sudo]")
    uninstall = actions.add_parser("uninstall", help="remove the services")
    for action in (install, uninstall):
        about = "a service beside the slave; may be given several times"
        action.add_argument("--service", metavar="NAME", action="append", default=[], help=about)
        action.add_argument("--dry-run", action="store_true", help="only show what would change")
        action.add_argument("--yes", action="store_true", help="do not ask")
    for action in (show, install, uninstall):
        about = "folder that holds the machine's /proc, /sys, /etc [/]"
        action.add_argument("--root", metavar="PATH", default="/", help=about)
    return parser


def listing() -> str:
    """Return one line a board."""
    rows: list[tuple[str, ...]] = [("preset", "board", "processor", "serial port", "CAN")]
    for name in preset_names("boards"):
        board = load_board(name)
        can = board.can[0].controller.partition(",")[0] if board.can else "-"
        rows.append((name, board.name, board.cpu, board.uart or "-", can))
    return "\n".join(aligned(rows))


def describe(tree: Tree, board: Board | None) -> str:
    """Return the machine's board, state, ports and budgets, as text for a terminal."""
    model_name = model(tree.root)
    if board is None:
        return f"not a known board: {model_name or 'no model name'}, {architecture(tree) or 'unknown architecture'}"
    rows = [
        ("processor", board.cpu),
        ("memory", _memory(tree, board)),
        ("system", board.system),
        ("wlan", board.wlan),
        ("temperature", _temperature(tree, board)),
        ("throttled", _throttled(throttling(tree, board))),
        ("governor", ", ".join(f"{name} ({count} processors)" for name, count in governors(tree).items())),
    ]
    parts = [f"{board.name}" + (f' (model "{model_name}")' if model_name else "")]
    parts += aligned([(f"  {name}", text or "unknown") for name, text in rows])
    for port in board.serial:
        parts.append(f"{port.device} {_presence(tree, port.device)}: {port.at}" + _needs(port.needs))
    for bus in board.can:
        presence = _presence(tree, f"/sys/class/net/{bus.interface}")
        parts.append(f"{bus.interface} {presence}: {bus.controller}" + _needs(bus.needs))
    for mode in board.power:
        watts = f", {mode.watts:g} W" if mode.watts else ""
        parts.append(f"power mode {mode.name}: {mode.cores} cores{watts} ({mode.command})")
    recommended, budgets = board.recommended, board.budgets
    parts.append(
        f"recommended: step {recommended.step * 1e3:g} ms, control_period {recommended.control_period * 1e3:g} ms, "
        f"at most {recommended.core_share:.0%} of a core and {recommended.memory:g} MiB"
    )
    parts.append(
        f"budgets: start {budgets.startup:g} s, memory {budgets.memory:g} MiB, {budgets.slave_cpu:.0%} of a core, "
        f"delay of a command {budgets.delay_p50 * 1e3:g} ms (median), {budgets.delay_p99 * 1e3:g} ms (99 %)"
    )
    return "\n".join([paragraph(line, "    ") for part in parts for line in part.split("\n")])


def to_json(tree: Tree, board: Board | None) -> dict[str, object]:
    """Return the description as plain values."""
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
    """Return records as dicts, at any depth."""
    if isinstance(value, tuple):
        fields = getattr(value, "_asdict", None)
        return {key: _plain(item) for key, item in fields().items()} if fields else [_plain(item) for item in value]
    return value


def _memory(tree: Tree, board: Board) -> str:
    sold = ", ".join(f"{size / 1024:g}" for size in board.ram)
    here = total_memory_mib(tree)
    texts = (f"sold with {sold} GiB" if sold else "", f"{here / 1024:.2f} GiB installed" if here else "")
    return "; ".join(text for text in texts if text)


def _temperature(tree: Tree, board: Board) -> str:
    value = temperature(tree, board)
    limit = f", throttles from {board.throttles_at:g} °C" if board.throttles_at else ""
    return f"{value:.1f} °C{limit}" if value is not None else ""


def _throttled(slow: Throttling) -> str:
    before = f"since boot: {', '.join(slow.before)}" if slow.before else ""
    return "; ".join(filter(None, (", ".join(slow.now), before))) or ("no" if slow.known else "")


def _presence(tree: Tree, name: str) -> str:
    real = tree.resolve(name)
    if not tree.exists(real):
        return "(not present)"
    return f"({real})" if real != name and real.startswith("/dev/") else "(present)"


def _needs(text: str) -> str:
    return f"\n    needs {text}" if text else ""
