"""Common parts of commands that grid a seabed: options for reading files, and the progress on a terminal."""

import argparse
import sys

from hil.common.options import Number

RESOLUTION = Number(0.05, 10_000.0, "m")


def add_reading(parser: argparse._ActionsContainer) -> None:
    """Add --resolution, and what the user says of values that do not say it themselves."""
    parser.add_argument("--resolution", metavar="M", type=RESOLUTION, help="of the grid [what the data resolve]")
    parser.add_argument(
        "--positive",
        choices=("auto", "up", "down"),
        default="auto",
        help="direction of soundings and rasters [%(default)s: as names and signs say]",
    )
    parser.add_argument("--crs", metavar="EPSG:N", help="coordinate system of files that name none")
    parser.add_argument("--unit", choices=("m", "ft", "us-ft", "fathom"), help="of the depths, above what files state")
    parser.add_argument(
        "--layer", metavar="NAME[:N]", help="variable, band or column with the depths, and of several times the N-th"
    )


def show_progress(share: float) -> None:
    """Show progress (0 to 1) in one line of a terminal; the line is removed at 1."""
    if sys.stderr.isatty():
        print(
            f"\r\033[Kgridding {100.0 * share:.0f} %" if share < 1.0 else "\r\033[K",
            end="",
            file=sys.stderr,
            flush=True,
        )
