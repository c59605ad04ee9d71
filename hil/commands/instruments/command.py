"""`uuv-hil instruments`: serve the instruments of a vehicle at their wires."""

import argparse
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from hil.commands.listening import add_connect, own_endpoint
from hil.common.children import module_command, start_child
from hil.common.errors import DeviceError
from hil.common.options import add_file, add_scenario, changes_of, new_parser
from hil.common.stop import StopSignals, is_stopped
from hil.network.roles import open_master_session
from hil.scenario.config import load_scenario
from hil.scenario.fleet import as_member

EXAMPLES = """\
A sensor with the key `instrument` in its section stands at its own wire, as the device that a vehicle's computer reads.
A slave starts this command itself, unless it has instruments = false in [slave].

examples:
  uuv-hil instruments mine.toml                                     for a slave on this machine
  uuv-hil instruments mine.toml --connect tcp/192.168.3.116:7447    for a slave elsewhere
  uuv-hil instruments check mine.toml                               what a driver sees of them, and how late
"""


def main(arguments: list[str]) -> int:
    """Serve until stopped; return the exit code."""
    if hasattr(os, "sched_setscheduler"):  # Linux: drop a priority inherited from a slave, whose loop is more urgent
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    options = _parser().parse_args(arguments)
    scenario = load_scenario(options.scenario, changes_of(options))
    if scenario.member:
        scenario = as_member(scenario, options.vehicle)
    from hil.instruments.process import Instruments, fitted_names

    shared, alone = fitted_names(scenario)
    names = [options.only] if options.only else shared or alone[:1]
    with ExitStack() as stack:
        stop_fd = stack.enter_context(StopSignals())
        sent = None
        if options.sent:
            sent = stack.enter_context(open(options.sent, "a", encoding="utf-8", buffering=1))
        endpoints = options.connect or [own_endpoint(scenario)]
        session = stack.enter_context(
            open_master_session(*endpoints, network=scenario.network, security=scenario.security)
        )
        node = options.vehicle or scenario.slave.node
        serving = stack.enter_context(Instruments(scenario, session, node, names, _print, sent))
        others = [] if options.only else [name for name in alone if name not in names]
        ended = [stack.enter_context(_process(arguments, name)) for name in others]
        if not options.only:
            _print(f"instruments of {node} at {', '.join(endpoints)}; Ctrl-C ends it")
        serving.run([stop_fd, *ended])
        if not is_stopped(stop_fd, 0.0):
            raise DeviceError("the process of another instrument has ended, which has said why")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = new_parser("instruments", __doc__, EXAMPLES)
    add_scenario(parser, None)
    add_connect(parser)
    parser.add_argument("--vehicle", metavar="NAME", default="", help="vehicle [the scenario's]")
    parser.add_argument("--only", metavar="NAME", default="", help="serve this instrument alone [all]")
    add_file(parser, "--sent", metavar="FILE", help="file for a line a measurement: wire, bytes, its instant")
    return parser


@contextmanager
def _process(arguments: list[str], name: str) -> Iterator[int]:
    """Serve one instrument in a process of its own; provide a descriptor that is readable when that has ended."""
    process = start_child(module_command("hil.cli", "instruments", *arguments, "--only", name))
    ended = os.pidfd_open(process.pid)
    try:
        yield ended
    finally:
        os.close(ended)
        process.terminate()
        process.wait()


def _print(line: str) -> None:
    print(line, flush=True)
