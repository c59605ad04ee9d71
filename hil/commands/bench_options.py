"""The options that benchmarks share."""

import argparse
import sys
import time
from typing import Any

from hil.bench.limits import Limits, parse_cpus, parse_memory, parse_share
from hil.bench.plotting import check_picture
from hil.bench.record import Record, check_writable, save
from hil.tables import settings

OUTPUTS = ("json", "csv", "markdown", "png")
SAY_EVERY_S = 60.0  # where nobody looks on, such as in a log

_said_s = [time.monotonic()]  # when a line of progress was last left in a log


def add_scenario(parser: argparse.ArgumentParser) -> None:
    """SCENARIO and what is changed in it."""
    parser.add_argument("scenario", metavar="SCENARIO", nargs="?", default="paper_field", help="[%(default)s]")
    change = 'of the scenario, such as "slave.step=0.001"; may be given several times'
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help=change)


def add_limits(parser: argparse.ArgumentParser) -> None:
    """What makes a laptop stand for a small board."""
    limits = parser.add_argument_group("less than the machine has, for the slave; results are labelled")
    limits.add_argument("--cpus", metavar="LIST", help="these processors only: 0 or 0,2 or 0-3")
    limits.add_argument("--cpu-quota", metavar="SHARE", help="so much of one core: 25%%; without real-time scheduling")
    limits.add_argument("--memory", metavar="SIZE", help="so much memory: 512M, 1G; without cached files")


def add_json(parser: argparse.ArgumentParser) -> None:
    """Where the record goes."""
    parser.add_argument("--json", metavar="FILE", help="write the record, for `uuv-hil bench compare` and --against")


def changes_of(options: Any) -> dict[str, Any]:
    """The changes of `add_scenario`. Raises ConfigError."""
    return settings(options.set, "--set")


def limits_of(options: Any) -> Limits:
    """The limits of `add_limits`. Raises ConfigError."""
    return Limits(
        parse_cpus(options.cpus) if options.cpus else (),
        parse_share(options.cpu_quota) if options.cpu_quota else 0.0,
        parse_memory(options.memory) if options.memory else 0.0,
    )


def check_outputs(options: Any) -> None:
    """That all files which are asked for can be written, before anything is measured.

    Raises ConfigError, MissingExtraError.
    """
    for path in filter(None, (getattr(options, name, None) for name in OUTPUTS)):
        check_writable(path)
    if getattr(options, "png", None):
        check_picture(options.png)


def keep(record: Record, options: Any) -> None:
    """Say what makes the figures stand for something else, and write the record if asked. Raises ConfigError."""
    for label in record.labels:
        print(f"label: {label}")
    if options.json:
        save(record, options.json)


def show(text: str) -> None:
    """A line of progress in place of the last one; "" for none. In a log one a minute."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)
    elif text and time.monotonic() - _said_s[0] > SAY_EVERY_S:
        _said_s[0] = time.monotonic()
        print(text, file=sys.stderr, flush=True)
