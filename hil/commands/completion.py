"""`uuv-hil completion`: print the script with which a shell completes commands, options, scenarios and keys."""

import argparse
import os
from collections.abc import Callable
from importlib import import_module
from typing import Any

from hil.common.options import new_parser, subparsers
from hil.common.schema import preset_names
from hil.scenario.config import SCENARIOS

EXAMPLES = """\
examples:
  uuv-hil completion bash > ~/.local/share/bash-completion/completions/uuv-hil
  uuv-hil completion zsh > ~/.zfunc/_uuv-hil        with fpath+=~/.zfunc before compinit in ~/.zshrc
  uuv-hil completion fish > ~/.config/fish/completions/uuv-hil.fish
"""
SHELLS = ("bash", "zsh", "fish")
_PARSES = ("parse_args", "parse_intermixed_args", "parse_known_args")


class _ParserMade(BaseException):
    """Interrupts a command at its parser, and carries that parser."""

    def __init__(self, parser: argparse.ArgumentParser) -> None:
        super().__init__()
        self.parser = parser


def main(arguments: list[str]) -> int:
    """Print the completion script of a shell; return 0. Raises ConfigError."""
    from argcomplete.shell_integration import shellcode

    parser = new_parser("completion", __doc__, EXAMPLES)
    parser.add_argument("shell", choices=SHELLS, help="shell to print the script for")
    options = parser.parse_args(arguments)
    print(shellcode(["uuv-hil"], shell=options.shell))
    return 0


def answer_shell(commands: dict[str, tuple[str, str]]) -> None:
    """Write the completions of the command line in the environment's COMP_LINE, and end this process.

    commands: name -> module with a `main`, and what it does.
    """
    import argcomplete

    line = os.environ.get("COMP_LINE", "")[: int(os.environ.get("COMP_POINT", "0"))]
    argcomplete.autocomplete(parser_for(line.split()[1:], commands))


def parser_for(words: list[str], commands: dict[str, tuple[str, str]]) -> argparse.ArgumentParser:
    """Return a parser of all commands; only the command that `words` begin with has its options."""
    parser = argparse.ArgumentParser(prog="uuv-hil")
    parser.add_argument("-V", "--version", action="store_true")
    actions = parser.add_subparsers()
    families: dict[str, Any] = {}  # first word -> the actions of its parser
    for name, (module, purpose) in commands.items():
        *family, last = name.split()
        if family and family[0] not in families:
            first = actions.choices.get(family[0]) or actions.add_parser(family[0])  # it may be a command, too
            families[family[0]] = first.add_subparsers()
        beside = families[family[0]] if family else actions
        beside.add_parser(last, help=purpose)
        if words[: len(family) + 1] == name.split():
            beside.choices[last] = find_parser(module)
            _add_completers(beside.choices[last])
    return parser


def find_parser(module: str) -> argparse.ArgumentParser:
    """Return the parser that the `main` of a command creates. Raises RuntimeError if it creates none."""

    def stop(parser: argparse.ArgumentParser, *_: Any, **__: Any) -> None:
        raise _ParserMade(parser)

    real = {name: getattr(argparse.ArgumentParser, name) for name in _PARSES}
    for name in _PARSES:
        setattr(argparse.ArgumentParser, name, stop)
    try:
        import_module(module).main(["--help"])
    except _ParserMade as found:
        return found.parser
    finally:
        for name, method in real.items():
            setattr(argparse.ArgumentParser, name, method)
    raise RuntimeError(f"{module}: main has created no parser")


def _add_completers(parser: argparse.ArgumentParser) -> None:
    """Complete SCENARIO, vehicles, worlds, boards and protocols by their names, KEY=... by the keys of a scenario."""
    for inner in subparsers(parser).values():
        _add_completers(inner)
    for action in parser._actions:
        names = (str(action.metavar).partition("=")[0], *(action.option_strings or [action.dest]))
        completer = next((COMPLETERS[name] for name in names if name in COMPLETERS), None)
        if completer and not action.choices:
            action.completer = completer  # type: ignore[attr-defined]


def _presets(folder: str, *endings: str) -> Callable[..., list[str]]:
    """Return the completer of the presets in `folder`, and of files with these endings."""

    def complete(prefix: str, **_: Any) -> list[str]:
        from argcomplete.completers import FilesCompleter

        files = FilesCompleter(allowednames=endings)(prefix) if endings else []
        return [*preset_names(folder), *files]

    return complete


def _protocols(prefix: str, **_: Any) -> list[str]:
    from hil.links.protocols import PROTOCOLS

    return [name for name in PROTOCOLS if name.startswith(prefix)]


def _keys(prefix: str, **_: Any) -> list[str]:
    from hil.schemas.files import dotted_keys

    return [f"{key}=" for key in dotted_keys("scenario") if key.startswith(prefix)]


# By metavar up to its "=", by option, or by a positional argument's name. `--vehicle` is the name of a running vehicle.
COMPLETERS = {
    "SCENARIO": _presets(SCENARIOS, "toml"),
    "KEY": _keys,
    "vehicle": _presets("sim/vehicles", "toml"),
    "world": _presets("sim/worlds", "toml"),
    "--world": _presets("sim/worlds", "toml"),
    "--board": _presets("boards"),
    "--protocol": _protocols,
}
