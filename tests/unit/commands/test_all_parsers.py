"""Each option has one name, one meaning and one default in every command, and every help text fits a terminal."""

import argparse
import ast
import re
import shlex
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

import hil.commands
from hil.cli import ALIASES, COMMANDS, find_command
from hil.commands.completion import find_parser
from hil.common.options import subparsers

FOLDER = Path(hil.commands.__file__).parent
MODULES = [module for module, _ in COMMANDS.values()]
# Names that an option may not have, and the name to use.
OTHER_NAMES = {
    "--out": "--output", "--run-dir": "--output", "--dest": "--output", "--log": "--output", "--slave": "--connect",
    "--host-port": "--listen", "--bind": "--listen", "--address": "--listen",
    "--png": "--plot", "--picture": "--plot", "--figure": "--plot", "--format": "--json", "--runs": "--repeat",
}  # fmt: skip
# The same word with another meaning, with the reason.
OTHER_MEANINGS = {
    ("uuv-hil gateway foxglove", "--listen"): "a websocket, no zenoh endpoint",
    ("uuv-hil gateway rosbridge", "--listen"): "a websocket, no zenoh endpoint",
    ("uuv-hil gateway ros1", "--listen"): "a node of ROS 1, no zenoh endpoint",
    ("uuv-hil view", "--listen"): "a web page, no zenoh endpoint",
    ("uuv-hil gateway json", "--listen"): "lines of JSON, no zenoh endpoint",
    ("uuv-hil bench echo", "--listen"): "an address without a port, which is any that is free",
    ("uuv-hil keys add", "--host"): "a machine",
}
# Options whose values differ from command to command.
COMMAND_SPECIFIC = {"--output", "--plot", "--rate", "--seconds", "--repeat", "--wait", "--seed", "--option"}
# Commands that take a scenario without --set, with the reason.
WITHOUT_SET = {
    "uuv-hil scenario show": "prints the file as it is",
    "uuv-hil fleet status": "shows what `up` has started",
    "uuv-hil fleet down": "stops what `up` has started",
}


def parsers(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """Yield a parser and those of its subcommands."""
    yield parser
    for inner in subparsers(parser).values():
        yield from parsers(inner)


ALL_PARSERS = [parser for module in MODULES for parser in parsers(find_parser(module))]
LEAVES = [parser for parser in ALL_PARSERS if not subparsers(parser)]


def options(parser: argparse.ArgumentParser) -> dict[str, argparse.Action]:
    """Return the options of a parser by their long names."""
    return {action.option_strings[-1]: action for action in parser._actions if action.option_strings}


def test_all_commands_are_checked() -> None:
    names = {find_command(parser.prog.split()[1:])[0] for parser in ALL_PARSERS}
    assert names == set(COMMANDS)
    assert len(LEAVES) > 45


def test_a_former_name_runs_the_present_command_and_names_it(capsys: pytest.CaptureFixture[str]) -> None:
    for former, present in ALIASES.items():
        name, words = find_command([former, "--listen", "0"])
        assert capsys.readouterr().err == f"`uuv-hil {former}` is now `uuv-hil {present}`\n"
        assert (name, words) == find_command([*present.split(), "--listen", "0"])
        assert name in COMMANDS


def test_every_help_has_a_purpose_and_its_examples() -> None:
    for parser in ALL_PARSERS:
        text = parser.format_help()
        assert parser.description, parser.prog
        example = rf"^examples:\n(.*\n)*? +.*{re.escape(parser.prog)}\b"
        assert re.search(example, text, flags=re.MULTILINE), parser.prog


def test_every_example_is_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each example is parsed by its command as typed; a comment stands behind two spaces or behind #."""
    monkeypatch.setenv("COLUMNS", "500")
    roots = {" ".join(root.prog.split()[1:]): root for root in map(find_parser, MODULES)}
    lines = {line for parser in ALL_PARSERS for line in parser.format_help().partition("\nexamples:\n")[2].splitlines()}
    commands = {shell.partition("uuv-hil ")[2] for line in lines for shell in re.findall(r"^  \S.*?(?=\s{2}|$)", line)}
    understood = 0
    for command in filter(None, commands):
        words = shlex.split(command, comments=True)
        words = words[: next((at for at, word in enumerate(words) if word in ("|", "&", "&&", ">")), len(words))]
        name, rest = find_command(words)
        roots[name].parse_args(rest)
        understood += 1
    assert understood > 150


def test_the_same_option_has_the_same_name_everywhere() -> None:
    for parser in LEAVES:
        for name in options(parser):
            assert name not in OTHER_NAMES, f"{parser.prog}: {name} is called {OTHER_NAMES[name]}"


def test_the_same_name_has_the_same_meaning_everywhere() -> None:
    """Two commands with an option of one name read its value alike, and show it alike."""
    usage: dict[str, dict[object, list[str]]] = defaultdict(lambda: defaultdict(list))
    for parser in LEAVES:
        for name, action in options(parser).items():
            if (parser.prog, name) not in OTHER_MEANINGS and name not in ("--help", *COMMAND_SPECIFIC):
                usage[name][(type(action).__name__.lstrip("_"), action.metavar, action.nargs)].append(parser.prog)
    ambiguous = {name: dict(kinds) for name, kinds in usage.items() if len(kinds) > 1}
    for name in ALLOWED:
        ambiguous.pop(name, None)
    assert not ambiguous


def test_each_shared_option_is_defined_once() -> None:
    """An option that several commands offer with one meaning is defined once, in a function that adds it."""
    commands_of_text: dict[tuple[str, str], list[str]] = defaultdict(list)
    for path in sorted(FOLDER.rglob("*.py")):
        for call in ast.walk(ast.parse(path.read_text())):
            if not (isinstance(call, ast.Call) and ast.unparse(call.func).rpartition(".")[2].startswith("add")):
                continue
            names = [word.value for word in call.args if isinstance(word, ast.Constant) and str(word.value)[:2] == "--"]
            texts = [ast.unparse(keyword.value) for keyword in call.keywords if keyword.arg == "help"]
            if names and texts:
                commands_of_text[str(names[0]), texts[0]].append(f"{path.name}:{call.lineno}")
    assert len(commands_of_text) > 100
    assert {option: where for option, where in commands_of_text.items() if len(where) > 1} == {}


# Lists of values in a benchmark that measures every combination, where another command has one value.
ALLOWED = {"--baud", "--protocol", "--stm32", "--connect"}


def test_common_options_have_their_usual_form() -> None:
    for parser in LEAVES:
        options_of_parser = options(parser)
        if "--output" in options_of_parser:
            assert options_of_parser["--output"].option_strings == ["-o", "--output"]
        if "--json" in options_of_parser:
            assert options_of_parser["--json"].nargs == 0, f"{parser.prog}: --json prints JSON; a file is --output"
        if "--plot" in options_of_parser:
            assert options_of_parser["--plot"].metavar == "FILE.png"
        if "--connect" in options_of_parser:
            assert options_of_parser["--connect"].metavar == "ENDPOINT"
        if "--listen" in options_of_parser:
            assert options_of_parser["--listen"].metavar in ("ENDPOINT", "[HOST:]PORT", "ADDRESS")


def test_every_command_that_reads_a_scenario_offers_set() -> None:
    for parser in LEAVES:
        reads = "--scenario" in options(parser) or any(action.metavar == "SCENARIO" for action in parser._actions)
        if reads and parser.prog not in WITHOUT_SET:
            assert options(parser)["--set"].metavar == "KEY=VALUE"
        positional = [
            action for action in parser._actions if action.metavar == "SCENARIO" and not action.option_strings
        ]
        for action in positional:
            assert action.default in (None, "paper_field"), parser.prog
        assert not (positional and "--scenario" in options(parser)), (
            f"{parser.prog}: a scenario can be named by two arguments"
        )
