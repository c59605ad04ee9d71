"""`uuv-hil schema`: print the JSON Schema of a file, with which an editor completes and checks it."""

import os

from hil.bench.record import write_text
from hil.common.errors import ConfigError
from hil.common.options import add_output, new_parser
from hil.common.tables import output_file
from hil.common.text import json_text
from hil.schemas.files import KINDS, schema

EXAMPLES = f"""\
KIND is {", ".join(KINDS)}. Without KIND, -o DIR gets one file of each kind.

examples:
  uuv-hil schema scenario -o scenario.schema.json
  uuv-hil schema -o schemas

The first line of a TOML file then names its schema, for Even Better TOML (VS Code) and taplo:

  #:schema schemas/scenario.schema.json
"""


def main(arguments: list[str]) -> int:
    """Print or write schemas; return 0. Raises ConfigError."""
    parser = new_parser("schema", __doc__, EXAMPLES)
    parser.add_argument("kind", metavar="KIND", nargs="?", help="kind of file")
    add_output(parser, "FILE|DIR", "where to write it [the screen]")
    options = parser.parse_args(arguments)
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
    write_text(path, text)
    print(f"written: {path}")
