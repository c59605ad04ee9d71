"""`uuv-hil bench`: measure what a board, a link or a network can do."""

import signal
import textwrap
from collections.abc import Callable
from importlib import import_module

from hil.commands.bench.options import show
from hil.common.columns import aligned
from hil.common.errors import EXIT_CODES, ConfigError, require_linux
from hil.common.schema import nearest
from hil.common.stop import stop_signals

# name -> module with `main(arguments) -> exit code`, and what it does
BENCHMARKS = {
    "table": (
        "hil.commands.bench.table",
        "master CPU, start-up, memory and command delay, beside the reference platform's",
    ),
    "delay": ("hil.commands.bench.delay", "where a command's time goes, by load, rate, link, STM32"),
    "echo": ("hil.commands.bench.echo", "echo bare messages beside a slave elsewhere, for the floor of the delay"),
    "startup": ("hil.commands.bench.startup", "what a start costs, cold and warm, phase by phase"),
    "jitter": ("hil.commands.bench.jitter", "how late the loop wakes up, compared with the kernel"),
    "load": ("hil.commands.bench.load", "CPU and memory over time, by sensors, rates and numbers of vehicles"),
    "stream": ("hil.commands.bench.stream", "what reaches the master: rates, loss, age, bandwidth"),
    "soak": ("hil.commands.bench.soak", "hours of running: growth, drift, reconnects"),
    "compare": ("hil.commands.bench.compare", "which differences between two results are real"),
}


def main(arguments: list[str]) -> int:
    """Run one benchmark; return its exit code."""
    name = arguments[0] if arguments else "--help"
    if name in ("-h", "--help"):
        print(_help())
        return 0
    if name not in BENCHMARKS:
        raise ConfigError(f"no benchmark {name!r}{nearest(name, list(BENCHMARKS))}; there are: {', '.join(BENCHMARKS)}")
    if name != "compare":
        require_linux(f"bench {name}")
    for number in stop_signals():
        signal.signal(number, signal.default_int_handler)  # so that each ends the processes that were started
    run: Callable[[list[str]], int] = import_module(BENCHMARKS[name][0]).main
    try:
        return run(arguments[1:])
    finally:
        show("")  # an error must not follow a line of progress on the same line


def _help() -> str:
    rows = "\n".join(aligned([(name, text) for name, (_, text) in BENCHMARKS.items()], indent="  "))
    return f"""usage: uuv-hil bench BENCHMARK [OPTIONS]

Measure what a board, a link or a network can do.
Run nothing else on the machine meanwhile.

benchmarks:
{rows}

examples:
  uuv-hil bench table --check               this machine, against its budgets
  uuv-hil bench table --connect tcp/192.168.3.116:7447 --output pi.json
  uuv-hil bench delay --protocol mavlink --stm32 native
  uuv-hil bench compare before.json after.json --fail-on-regression

uuv-hil bench BENCHMARK --help shows each one's options.

{textwrap.fill(EXIT_CODES, 79)}"""
