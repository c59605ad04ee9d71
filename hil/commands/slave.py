"""`uuv-hil slave`: be the vehicle."""

import argparse

from hil.clock import now_ns, process_start_ns

EXAMPLES = """\
SCENARIO is a .toml file or the name of an installed scenario.

examples:
  uuv-hil slave paper_field                                   for a master on this machine
  uuv-hil slave paper_field --listen tcp/0.0.0.0:7447         for a master on the network
  uuv-hil slave mine.toml --board raspberry_pi_4b             with that board's serial port

Without authentication anyone who reaches the port can command the vehicle: listen on 0.0.0.0 only on a
network you trust. Two ports are used, the one given and the next.
Ctrl-C and SIGTERM end it with the thrusters neutral.
"""


def main(arguments: list[str]) -> int:
    """Run the slave until it is told to stop; the exit code."""
    startup = {"exec": process_start_ns(), "python": now_ns()}
    parser = argparse.ArgumentParser(
        prog="uuv-hil slave",
        description=__doc__,
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("scenario", metavar="SCENARIO")
    parser.add_argument("--listen", metavar="ENDPOINT", help="where masters connect, tcp/ADDRESS:PORT [the scenario's]")
    parser.add_argument("--board", metavar="NAME", help="the card computer this is [recognised by its device tree]")
    parser.add_argument("--device", metavar="PATH", help="serial device of the thruster link, or link to its pty")
    options = parser.parse_args(arguments)
    _run(options, startup)
    return 0


def _run(options: argparse.Namespace, startup: dict[str, int]) -> None:
    from boards import load_board
    from hil.config import load_scenario
    from hil.slave import daemon

    startup["imports"] = now_ns()
    scenario = load_scenario(options.scenario)
    if options.listen:
        scenario = scenario._replace(slave=scenario.slave._replace(listen=options.listen))
    if options.device:
        scenario = scenario._replace(link=scenario.link._replace(device=options.device))
    board = load_board(options.board) if options.board else None
    daemon.run(scenario, board, startup)
