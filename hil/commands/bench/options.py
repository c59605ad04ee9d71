"""The options that benchmarks share."""

import argparse
import sys
import time
from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any

from hil.bench.limits import Limits, parse_cpus, parse_memory
from hil.bench.record import Figure, Record, new_record, save
from hil.common.options import DAY_S, REPEAT, Number, Share, add_output, add_plot, checked
from hil.plots.plotting import check_picture

CPU_SHARE = Share(0.01, 64.0)  # of one core
NO_SETTINGS = ("output", "plot", "csv", "markdown", "against", "check")  # options that change no figure
PRINT_EVERY_S = 60.0  # where the output is not a terminal, such as in a log


def add_limits(parser: argparse.ArgumentParser) -> None:
    """Add the options that limit a laptop to the resources of a small board."""
    limits = parser.add_argument_group("limits of the slave, below what the machine has; results are labelled")
    limits.add_argument(
        "--cpus", metavar="LIST", type=checked(parse_cpus), default=(), help="processors to use: 0 or 0,2 or 0-3"
    )
    limits.add_argument(
        "--cpu-quota",
        metavar="SHARE",
        type=CPU_SHARE,
        default=0.0,
        help="share of one core: 25%%; disables real-time scheduling",
    )
    limits.add_argument(
        "--memory",
        metavar="SIZE",
        type=checked(parse_memory),
        default=0.0,
        help="memory limit: 512M, 1G; cached files not included",
    )


def add_results(parser: argparse.ArgumentParser, picture: str = "") -> None:
    """Add --output for the record, and --plot if there is a `picture`; `check_plot` and `save_record` read them."""
    add_output(parser, "FILE.json", "write the record")
    if picture:
        add_plot(parser, picture)


def add_seconds(parser: argparse.ArgumentParser, default: float, of: str, least: float = 1.0) -> None:
    """Add --seconds, the duration of each `of`, at least `least` s."""
    kind, about = Number(least, DAY_S, "s"), f"duration of each {of} [%(default)s]"
    parser.add_argument("--seconds", type=kind, default=default, metavar="S", help=about)


def add_repeat(parser: argparse.ArgumentParser, default: int, what: str) -> None:
    """Add --repeat, the number of repetitions; `what` says what is repeated."""
    parser.add_argument("--repeat", type=REPEAT, default=default, metavar="N", help=f"{what} [%(default)s]")


def limits_of(options: Any) -> Limits:
    """Return the limits of `add_limits`."""
    return Limits(options.cpus, options.cpu_quota, options.memory)


def check_plot(options: Any) -> None:
    """Check that the picture of `--plot` can be drawn. Raises ConfigError, MissingExtraError."""
    if options.plot:
        check_picture(options.plot)


def save_record(
    kind: str, options: Any, figures: dict[str, Figure], labels: Iterable[str], details: dict[str, Any] | None = None
) -> Record:
    """Return the record, and write it if requested; warn of conditions that change figures. Raises ConfigError."""
    settings = {key: value for key, value in vars(options).items() if key not in NO_SETTINGS}
    record = new_record(kind, settings, figures, labels, details)
    for label in record.labels:
        print(f"label: {label}")
    if options.output:
        save(record, options.output)
    return record


class Progress:
    """Progress of a benchmark on standard error."""

    def __init__(self) -> None:
        self._logged_s = time.monotonic()  # when a line was last printed in a log

    def show(self, text: str) -> None:
        """Show a line in place of the last one; "" removes it. In a log, print one line a minute."""
        if sys.stderr.isatty():
            print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)
        elif text and time.monotonic() - self._logged_s > PRINT_EVERY_S:
            self._logged_s = time.monotonic()
            print(text, file=sys.stderr, flush=True)


show = Progress().show


def benchmark(main: Callable[[list[str]], int]) -> Callable[[list[str]], int]:
    """Remove the line of progress at the end of a benchmark's `main`, so that no error follows it on the same line."""

    @wraps(main)
    def run(arguments: list[str]) -> int:
        try:
            return main(arguments)
        finally:
            show("")

    return run
