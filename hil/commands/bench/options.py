"""What benchmarks share: options, progress, the record of the figures, and failures of parts of a measurement."""

import argparse
import shlex
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from typing import Any

from hil.bench.record import Figure, Record, new_record, save
from hil.bench.report import Column, Row, draw
from hil.common.errors import HilError
from hil.common.options import (
    DAY_S,
    REPEAT,
    Number,
    add_output,
    add_plot,
    add_scenario,
    endpoint_or_lan,
    new_parser,
)
from hil.common.schema import shortened
from hil.plots.plotting import check_picture

NO_SETTINGS = ("output", "plot", "against", "check")  # options that change no figure
PRINT_EVERY_S = 60.0  # where the output is not a terminal, such as in a log


def bench_parser(name: str, description: str | None, examples: str) -> argparse.ArgumentParser:
    """Return the parser of `uuv-hil bench NAME`, with the scenario, --under, and the files of the results.

    --under is the command that runs the slave, so that a laptop has the resources of a small board.
    """
    parser = new_parser(f"bench {name}", description, examples)
    add_scenario(parser)
    about = 'command that runs the slave, such as "taskset -c 0"; results are labelled'
    parser.add_argument("--under", metavar="COMMAND", type=_command, default=[], help=about)
    add_output(parser, "FILE.json", "write the record")
    add_plot(parser, "draw the figures")
    return parser


def parse(parser: argparse.ArgumentParser, arguments: list[str]) -> Any:
    """Return the options, after a test that the picture of --plot can be drawn. Raises ConfigError."""
    options = parser.parse_args(arguments)
    if options.plot:
        check_picture(options.plot)
    return options


def _command(text: str) -> list[str]:
    """Return the words of a command, after a test that its program can be run."""
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{shortened(text)}: {error}") from None
    if not words or not shutil.which(words[0]):
        raise argparse.ArgumentTypeError(f"no program {shortened(text)} here; name it by its path, or install it")
    return words


def add_connect(parser: argparse.ArgumentParser, **how: Any) -> None:
    """Add --connect, a slave that runs already."""
    slave = "endpoint of a running slave, or lan [one is started here]"
    parser.add_argument("--connect", metavar="ENDPOINT", type=endpoint_or_lan, help=slave, **how)


def add_seconds(parser: argparse.ArgumentParser, default: float, of: str, least: float = 1.0) -> None:
    """Add --seconds, the duration of each `of`, at least `least` s."""
    kind, about = Number(least, DAY_S, "s"), f"duration of each {of} [%(default)s]"
    parser.add_argument("--seconds", type=kind, default=default, metavar="S", help=about)


def add_repeat(parser: argparse.ArgumentParser, default: int, what: str) -> None:
    """Add --repeat, the number of repetitions; `what` says what is repeated."""
    parser.add_argument("--repeat", type=REPEAT, default=default, metavar="N", help=f"{what} [%(default)s]")


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


def save_columns(
    kind: str,
    options: Any,
    columns: Sequence[Column],
    rows: Sequence[Row],
    labels: Iterable[str],
    details: dict[str, Any] | None = None,
) -> None:
    """Save columns as a record, as "row [column]", and draw them, if requested. Raises ConfigError."""
    figures = {f"{name} [{column.title}]": each for column in columns for name, each in column.figures.items()}
    record = save_record(kind, options, figures, labels, details)
    if options.plot:
        draw(columns, rows, options.plot, record.footer)


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


class PartialFailures:
    """The errors and the Ctrl-C that ended measurements, reported beside the figures and raised at the end."""

    def __init__(self) -> None:
        self._current = ""
        self._errors: list[tuple[str, HilError | KeyboardInterrupt]] = []

    def begin(self, what: str) -> None:
        """Show what is measured from now on, which failures are reported with."""
        self._current = what
        show(what)

    @contextmanager
    def caught(self) -> Iterator[None]:
        """Store an error that is raised inside; only the `with` block ends, and with it the line of progress."""
        try:
            yield
        except (HilError, KeyboardInterrupt) as error:
            self._errors.append((self._current, error))
        finally:
            show("")

    @property
    def stopped(self) -> bool:
        """True if a person or a signal ended the run: then stop measuring."""
        return any(isinstance(error, KeyboardInterrupt) for _, error in self._errors)

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the labels of figures that are incomplete."""
        return tuple(
            f"RUN FAILED: {place}: {error}" if isinstance(error, HilError) else f"STOPPED: {place}"
            for place, error in self._errors
        )

    def most(self, times: int) -> str:
        """Return the number of repetitions of each figure as text: "5", or "up to 5" after a failure."""
        return f"up to {times}" if self._errors else str(times)

    def raise_first(self) -> None:
        """Raise the first error, if there is one: its exit code is the benchmark's."""
        for _, error in self._errors:
            raise error
