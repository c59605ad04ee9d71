"""`uuv-hil scenario schema`: print the JSON Schema of a file, with which an editor completes and checks it."""

import argparse
import os
from typing import Any

from hil.common.errors import ConfigError
from hil.common.options import add_output
from hil.common.tables import output_file, save_text
from hil.common.text import json_text


def add_to(actions: Any) -> None:
    """Add the action to those of `uuv-hil scenario`."""
    parser = actions.add_parser("schema", help="print the JSON Schema of a kind of file, for editors")
    parser.add_argument("kind", metavar="KIND", nargs="?", help="scenario, vehicle, world, ... [all, into a folder]")
    add_output(parser, "FILE|DIR", "where to write it [the screen]")


def write_schemas(options: argparse.Namespace) -> int:
    """Print or write schemas; return 0. Raises ConfigError."""
    from hil.schemas.files import KINDS, schema

    if options.kind is None and options.output is None:
        raise ConfigError(f"which file? Name one of {', '.join(KINDS)}, or write all into a folder with --output DIR")
    if options.kind is not None:
        text = json_text(schema(options.kind), indent=2) + "\n"
        if options.output is None:
            print(text, end="")
        else:
            _write(output_file(options.output), text)
        return 0
    for kind in KINDS:
        _write(os.path.join(options.output, f"{kind}.schema.json"), json_text(schema(kind), indent=2) + "\n")
    return 0


def _write(path: str, text: str) -> None:
    save_text(path, text)
    print(f"written: {path}")
