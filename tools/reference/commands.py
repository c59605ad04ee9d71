"""Parts of the page of the commands: arguments, options and exit codes, from the argument parsers."""

import argparse
import re
from collections.abc import Iterator
from inspect import getdoc

from hil.cli import COMMANDS, FAMILIES
from hil.commands.completion import find_parser
from hil.common import errors
from hil.common.options import subparsers
from tools.reference.records import rows

KINDS = (
    errors.HilError, errors.ConfigError, errors.DeviceError, errors.NetworkError, errors.MissingExtraError,
    errors.MissionError,
)  # fmt: skip
OTHER_CODES = {
    0: "The command succeeded.",
    errors.STOPPED: "Ctrl-C or a signal ended it. Commands that run until then, as `slave` and `router`, return 0.",
    141: "The program that reads its output ended, as in `uuv-hil ... | head`.",
}
DEFAULT_MEANINGS = {"SCENARIO": "a `.toml` file, or the name of an installed scenario"}
CODE_1 = (
    "A check has found a problem (`doctor`, `scenario check`, `frame check`, `--check`, `--fail-on-regression`), "
    "or another error."
)


def codes() -> str:
    """Return the rows of the exit codes."""
    meanings = {kind.exit_code: (getdoc(kind) or "").split("\n")[0] for kind in KINDS} | {1: CODE_1} | OTHER_CODES
    return rows(sorted(meanings.items()))


def sections() -> str:
    """Return a section for each command."""
    parts = []
    families = dict(FAMILIES)
    for name, (module, purpose) in COMMANDS.items():
        family, _, member = name.partition(" ")
        if member and (about := families.pop(family, "")):
            parts.append(_heading("##", family, about))
        parts.append(_heading("###" if member else "##", name, purpose))
        parts += _describe(find_parser(module))
    return "\n".join(parts)


def _heading(marks: str, name: str, about: str) -> str:
    return f"{marks} {name}\n\n{about[0].upper()}{about[1:]}.\n"


def _describe(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Yield the parts of one command: usage, table of options, subcommands, examples."""
    inner = subparsers(parser)
    name = parser.prog.removeprefix("uuv-hil ")
    is_part = name not in COMMANDS  # its command shows the examples
    actions = [a for a in parser._actions if not isinstance(a, (argparse._HelpAction, argparse._SubParsersAction))]
    if actions:
        yield "| argument | meaning |\n|---|---|\n" + "".join(_row(parser, action) for action in actions)
    if parser.epilog and not is_part:
        yield f"```text\n{parser.epilog.rstrip()}\n```\n"
    for name, each in inner.items():
        command = f"{parser.prog.removeprefix('uuv-hil ')} {name}"
        about = f"{_sentence(each.description)}\n" if each.description else ""
        yield f"### {command}\n\n{about}"
        yield from _describe(each)


def _row(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    formatter = parser._get_formatter()
    meaning = formatter._expand_help(action) if action.help else DEFAULT_MEANINGS.get(str(action.metavar), "")
    is_named = action.metavar is not None or not action.option_strings  # otherwise its name lists the choices
    if is_named and action.choices is not None and not all(str(choice) in meaning for choice in action.choices):
        meaning += f" ({', '.join(map(str, action.choices))})"
    return f"| {_name(action)} | {_cell(meaning)} |\n"


def _name(action: argparse.Action) -> str:
    metavar = action.metavar if isinstance(action.metavar, str) else " ".join(action.metavar or ())
    if not action.option_strings:
        return f"`{metavar or action.dest}`"
    choices = f"{{{','.join(map(str, action.choices or ()))}}}"  # as in --help
    value = "" if action.nargs == 0 else f" {metavar or choices}"
    return ", ".join(f"`{name}{value}`" for name in action.option_strings)


def _cell(text: str) -> str:
    return re.sub(r"\s+", " ", text).replace("|", "\\|").replace("<", "&lt;").strip()


def _sentence(text: str) -> str:
    return _cell(text) if text.endswith(".") else f"{_cell(text)}."
