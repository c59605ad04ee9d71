"""`uuv-hil slave`: run the vehicle daemon on the board."""

import gc
from typing import TYPE_CHECKING, Any, NamedTuple

from hil.common import streams
from hil.common.clock import LOOP_PRIORITY, now_ns, process_start_ns, schedule_fifo

if TYPE_CHECKING:
    from boards import Board

EXAMPLES = """\
examples:
  uuv-hil slave paper_field                                   for a master on this machine
  uuv-hil slave paper_field --listen tcp/0.0.0.0:7447         for a master on the network
  uuv-hil slave mine.toml --board raspberry_pi_4b             with that board's serial port
  uuv-hil slave target_hunting --member uuv2                  one vehicle of a fleet

Without a [security] section anyone who reaches the port can command the vehicle: listen on 0.0.0.0 only on a
network you trust, or make certificates (uuv-hil keys --help). Two ports are used, the one given and the next.
Ctrl-C and SIGTERM end it with the thrusters neutral.
"""


class Options(NamedTuple):
    """Options of the command line."""

    scenario: str
    listen: str | None = None
    board: str | None = None
    port: str | None = None
    member: str = ""
    set: tuple[str, ...] = ()


PLAIN_OPTIONS = [f"--{name}" for name in Options._fields if name not in ("scenario", "set")]  # those with one value


def main(arguments: list[str]) -> int:
    """Run the slave until a signal stops it; return the exit code."""
    startup = {"exec": process_start_ns(), "python": now_ns()}
    gc.disable()  # not while modules load; the daemon configures it afterwards
    _run(_parse_plain(arguments) or _parse(arguments), startup)
    return 0


def _parse_plain(arguments: list[str]) -> Options | None:
    """Return the options of a plain command line, without argparse (8 ms of a start of 40); None for any other."""
    remaining, values = list(arguments), dict[str, Any]()
    while len(remaining) > 1 and remaining[-2] in PLAIN_OPTIONS:
        value, name = remaining.pop(), remaining.pop()
        values.setdefault(name[2:], value)  # the last value of an option counts, as in argparse
    plain = len(remaining) == 1 and not any(word.startswith("-") for word in (*remaining, *values.values()))
    return Options(remaining[0], **values) if plain else None


def _parse(arguments: list[str]) -> Options:
    from hil.common.options import add_board, add_listen, add_member, add_scenario, new_parser

    parser = new_parser("slave", __doc__, EXAMPLES)
    add_scenario(parser)
    add_listen(parser)
    add_board(parser)
    parser.add_argument(
        "--port", metavar="ADDRESS", help="address of the thruster link: /dev/ttyUSB0, pty:/tmp/name, can:..."
    )
    add_member(parser)
    values = vars(parser.parse_args(arguments))
    return Options(**{**values, "set": tuple(values["set"])})


def _run(options: Options, startup: dict[str, int]) -> None:
    """Open the network while the other modules are loaded, so that it does not lengthen the start."""
    from hil.scenario.config import load_scenario, with_port

    scenario = load_scenario(options.scenario, _changes(options))
    if options.member or scenario.member:
        from hil.scenario.fleet import as_member

        scenario = as_member(scenario, options.member)
    if options.listen:
        scenario = scenario._replace(slave=scenario.slave._replace(listen=_endpoint(options.listen)))
    if options.port:
        scenario = with_port(scenario, options.port)
    startup["scenario"] = now_ns()
    from hil.network.opening import Listening
    from hil.network.settings import save_threads
    from hil.ros import dialect

    pictures = any(fitted.offloaded for fitted in scenario.sensors.values())
    save_threads(pictures)
    notes = [schedule_fifo(LOOP_PRIORITY).text] if scenario.slave.realtime else ["real-time: off by the scenario"]
    if dialect.is_newer(scenario.ros.distro):
        notes.append(f"[ros] distro = {scenario.ros.distro!r} is not known here, and acts as rolling")
    network = Listening(scenario.slave.listen, scenario.network, scenario.security, pictures)
    try:
        from hil.slave import daemon

        startup["imports"] = now_ns()
        board = _load_board(options.board) if options.board else None
        daemon.run(scenario, board, network, startup, notes)
    finally:
        network.close()
    if network.is_stuck:  # everything else is closed and written, and the thrusters are neutral
        streams.leave(0)


def _changes(options: Options) -> dict[str, Any]:
    if not options.set:
        return {}
    from hil.common.options import changes_of

    return changes_of(options)


def _endpoint(text: str) -> str:
    """Return the endpoint with its scheme and port, as hil/common/options.py would. Raises ConfigError."""
    from hil.common.endpoint import full_endpoint
    from hil.common.errors import ConfigError, NetworkError

    try:
        return full_endpoint(text)
    except NetworkError as error:
        raise ConfigError(f"--listen: {error}") from None


def _load_board(name: str) -> "Board":
    from boards import load_board

    return load_board(name)
