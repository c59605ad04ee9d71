"""`uuv-hil plot`: draw the figures of a recording: trajectory, depth, commands and response, thrusters, delays."""

import os

from hil.commands.recording.options import add_recording
from hil.common.options import add_output, new_parser

EXAMPLES = """\
Pictures go where the recording is, unless -o says otherwise.

examples:
  uuv-hil plot recordings/dive7
  uuv-hil plot dive7.mcap -o pictures

A recording made with a scenario has the world's map in it. The pulses of the thrusters are complete in a slave's own
recording; other recordings have those of once a second. A recording can name classes for its forces and sensors, and
to load one is to run it: that is refused unless --own-classes is given, for your own.
"""


def main(arguments: list[str]) -> int:
    """Draw; return the exit code."""
    parser = new_parser("plot", __doc__, EXAMPLES)
    add_recording(parser)
    add_output(parser, "DIR", "a folder for the pictures [that of the recording]")
    options = parser.parse_args(arguments)
    from hil.plots.run_plots import plot_recording

    path = options.recording
    folder = options.output or (path if os.path.isdir(path) else os.path.dirname(os.path.abspath(path)))
    for file in plot_recording(path, folder, options.own_classes):
        print(file)
    return 0
