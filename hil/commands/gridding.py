"""Common parts of commands that grid a seabed: the option --resolution, and the progress on a terminal."""

import sys

from hil.common.options import Number

RESOLUTION = Number(0.05, 10_000.0, "m")


def show_progress(share: float) -> None:
    """A line on a terminal that renews itself, and goes when all is done."""
    if sys.stderr.isatty():
        print(
            f"\r\033[Kgridding {100.0 * share:.0f} %" if share < 1.0 else "\r\033[K",
            end="",
            file=sys.stderr,
            flush=True,
        )
