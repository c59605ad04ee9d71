"""`uuv-hil recording plot`: draw the figures of a recording, such as trajectory, depth, thrusters and delays."""

import os

from hil.commands.recording.options import add_recording
from hil.common.options import add_output, new_parser

EXAMPLES = """\
Pictures are written beside the recording, or into the folder of -o.

examples:
  uuv-hil recording plot recordings/dive7
  uuv-hil recording plot dive7.mcap -o pictures

A recording made with a scenario contains the world's map. The pulses of the thrusters are complete in a slave's own
recording; other recordings have one sample of them a second. A recording can name classes for its forces and sensors,
and loading a class runs its code: this is refused without --own-classes, which is for your own recordings.
"""


def main(arguments: list[str]) -> int:
    """Draw; return the exit code."""
    parser = new_parser("recording plot", __doc__, EXAMPLES)
    add_recording(parser)
    add_output(parser, "DIR", "a folder for the pictures [that of the recording]")
    options = parser.parse_args(arguments)
    from hil.plots.run_plots import plot_recording

    path = options.recording
    folder = options.output or (path if os.path.isdir(path) else os.path.dirname(os.path.abspath(path)))
    for file in plot_recording(path, folder, options.own_classes):
        print(file)
    return 0
