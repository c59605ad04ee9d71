"""The options that benchmarks share."""

import argparse
import shlex
import shutil
import sys
import time
from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any

from hil.bench.record import Figure, Record, new_record, save
from hil.common.options import DAY_S, REPEAT, Number, add_output, add_plot
from hil.common.schema import shortened
from hil.plots.plotting import check_picture

NO_SETTINGS = ("output", "plot", "csv", "markdown", "against", "check")  # options that change no figure
PRINT_EVERY_S = 60.0  # where the output is not a terminal, such as in a log


def add_under(parser: argparse.ArgumentParser) -> None:
    """Add --under, the command that runs the slave, so that a laptop has the resources of a small board."""
    about = 'command that runs the slave, such as "taskset -c 0"; results are labelled'
    parser.add_argument("--under", metavar="COMMAND", type=_command, default=[], help=about)


def _command(text: str) -> list[str]:
    """Return the words of a command, after a test that its program can be run."""
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{shortened(text)}: {error}") from None
    if not words or not shutil.which(words[0]):
        raise argparse.ArgumentTypeError(f"no program {shortened(text)} here; name it by its path, or install it")
    return words


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
