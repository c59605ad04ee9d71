"""The options of commands that read a recording."""

import argparse


def add_recording(parser: argparse.ArgumentParser) -> None:
    """Add FILE, the recording, and --own-classes, whether classes that it names are loaded."""
    parser.add_argument("recording", metavar="FILE", help="an .mcap file, or the folder of a recording")
    parser.add_argument("--own-classes", action="store_true", help="load the classes it names; only if you trust it")
