"""Every option of every command accepts only valid values: checked for all of them through their parsers."""

import argparse
from collections.abc import Iterator
from importlib import import_module
from typing import Any, NamedTuple

import pytest

from hil import cli
from hil.commands.world import area
from hil.common import options as parser
from hil.common.options import List, Number, Parser, Share, subparsers

# Metavars of options that are not numbers. Any other option needs a type of hil/common/options.py.
TEXTS = {
    "SCENARIO", "NAME", "DIR", "FOLDER", "FILE", "PATH", "WORLD", "VEHICLE", "TYPE", "VALUES", "TOPIC", "SERVICE",
    "HEX", "ADDRESS", "KEY=VALUE", "NAME=VALUE", "KEY=A,B,...", "NAME|FILE", "NAME|FILE.toml", "CHART.000",
    "MODEL", "WORLD.sdf", "FILE.bin", "FILE.csv", "FILE.png", "FILE.toml", "FILE.json", "A.json", "B.json",
    "OUT.pgm|.tif",
    "KIND", "FILE|DIR", "NODE=HOST", "COMMAND", "ACTION", "EPSG:N", "NAME[:N]", "TEXT",
}  # fmt: skip
VALUES = ["nan", "inf", "-inf", "-1", "0", "1e12", "x", "", "9" * 5000, "0x10", "1_0", "½", "1e400", "5 kg"]


class CapturedError(Exception):
    """An error that holds the parser of a command, raised before it reads anything."""


class AcceptedError(Exception):
    """An error that holds what a parser made of a command line."""


class Option(NamedTuple):
    """An option and the command that has it."""

    arguments: tuple[str, ...]
    parser: argparse.ArgumentParser
    action: argparse.Action

    @property
    def name(self) -> str:
        return self.action.option_strings[-1] if self.action.option_strings else str(self.action.metavar)


def commands() -> Iterator[tuple[tuple[str, ...], str]]:
    for name, (module, _) in cli.COMMANDS.items():
        yield tuple(name.split()), module


def parser_of(module: str) -> Parser:
    """Return the parser that a command reads its command line with, intercepted before it does."""

    def catch(self: Parser, *_: Any) -> None:
        raise CapturedError(self)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Parser, "parse_args", catch)
        patch.setattr(Parser, "parse_intermixed_args", catch)
        with pytest.raises(CapturedError) as caught:
            import_module(module).main([])
    found = caught.value.args[0]
    assert isinstance(found, Parser)
    return found


def options() -> Iterator[Option]:
    for words, module in commands():
        outer = parser_of(module)
        for inner_words, inner in ((words, outer), *(((*words, name), one) for name, one in subparsers(outer).items())):
            for action in inner._actions:
                takes_value = action.nargs != 0 and not isinstance(action, argparse._SubParsersAction)
                if takes_value and not isinstance(action, (argparse._HelpAction, argparse.BooleanOptionalAction)):
                    yield Option(inner_words, inner, action)


OPTIONS = list(options())
NUMBERS = [
    option for option in OPTIONS if isinstance(option.action.type, (Number, List)) and option.action.option_strings
]


def test_every_option_is_text_a_choice_or_has_a_checked_type() -> None:
    for option in OPTIONS:
        kind = option.action.type
        assert kind not in (int, float), f"{option.arguments} {option.name}: use a type of hil/common/options.py"
        if kind is None and not option.action.choices:
            known = option.action.metavar in TEXTS
            assert known, f"{option.arguments} {option.name}: a text? then add its metavar here; else give it a type"
    assert len(NUMBERS) > 60, "the parsers were not found"


def command_line(option: Option, value: str) -> list[str]:
    """Return a command line with that option, and a value for every required argument."""
    inner = option.parser
    required = [action for action in inner._actions if action.required and action is not option.action]
    arguments = [*option.arguments, f"{option.name}={value}"]
    for action in required:
        dummy = next(iter(action.choices)) if action.choices else "tcp/127.0.0.1:1"
        arguments += [action.option_strings[-1], dummy] if action.option_strings else [dummy]
    return arguments


def accept(self: Parser, *arguments: Any) -> None:
    raise AcceptedError(original_parse_args(self, *arguments))


original_parse_args = Parser.parse_args


def test_a_number_out_of_range_gives_one_line_and_exit_code_2(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(Parser, "parse_args", accept)
    for option in NUMBERS:
        check_numbers(option, capsys)


def check_numbers(option: Option, capsys: pytest.CaptureFixture[str]) -> None:
    """Assert that each of VALUES for that option is accepted in its range, or refused by its name."""
    kind = option.action.type
    number = kind.item if isinstance(kind, List) else kind
    for value in VALUES:
        try:
            code = cli.main(command_line(option, value))
        except AcceptedError as accepted:
            made = getattr(accepted.args[0], option.action.dest)
            for one in made if isinstance(made, (tuple, list)) else [made]:
                assert isinstance(number, Number), f"{value!r} was accepted"
                assert number.low <= one <= number.high or one in number.also, f"{value!r} was accepted"
            continue
        output = capsys.readouterr().err
        assert code == 2, (value, output)
        assert output.count("\n") == 1, output
        assert option.name in output
        assert "expected" in output
        assert repr(value[:10])[:-1] in output, "the error repeats the typed text"


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        (Number(0.0, 10.0, "s"), "500 ms", 0.5),
        (Number(0.0, 10.0, "s"), " 3 ", 3.0),
        (Number(1.0, 10.0, also=(0,)), "0", 0.0),
        (parser.integer(1, 5), "5", 5),
        (Share(), "5%", 0.05),
        (List(parser.integer(0, 9)), "1,2,1", (1, 2)),
        (parser.serving_address, "9747", ("127.0.0.1", 9747)),
        (parser.serving_address, "[::1]:0", ("::1", 0)),
        (parser.host, "pi.local", "pi.local"),
        (parser.ENDPOINT, "192.168.3.116", "tcp/192.168.3.116:7447"),
        (parser.ENDPOINT, "pi:9000", "tcp/pi:9000"),
        (parser.ENDPOINT, "[::1]", "tcp/[::1]:7447"),
        (parser.ENDPOINT, "[::1]:9000", "tcp/[::1]:9000"),
        (parser.ENDPOINT, "tls/pi", "tls/pi:7447"),
        (parser.endpoint_or_lan, "lan", "lan"),
        (parser.lat_lon, "59.6,-151.4", (59.6, -151.4)),
    ],
)
def test_valid_texts_are_parsed(kind: Any, text: str, value: Any) -> None:
    assert kind(text) == value


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        (parser.PORT, "65536"),
        (parser.ENDPOINT, "pi:65535"),  # its neighbour is used too
        (parser.ENDPOINT, "pi:99999999999999999999"),
        (parser.ENDPOINT, "::1"),
        (parser.ENDPOINT, "udp/pi:7447"),
        (parser.ENDPOINT, "tcp/pi:²"),
        (parser.ENDPOINT, "not a host"),
        (parser.ENDPOINT, ""),
        (parser.serving_address, "127.0.0.1:99999"),
        (parser.serving_address, "here"),
        (parser.host, "not a host!!"),
        (parser.host, "1.2.3"),
        (parser.host, "x" * 300),
        (parser.lat_lon, "91,0"),
        (parser.lat_lon, "nan,0"),
        (area, "1,2,1,3"),
        (List(parser.integer(0, 9), most=2), "1,2,3"),
    ],
)
def test_invalid_texts_are_refused_in_a_short_message(kind: Any, text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError) as error:
        kind(text)
    assert len(str(error.value)) < 300


@pytest.mark.parametrize("arguments", [[], ["--member="]], ids=["without argparse", "with argparse"])
def test_the_slave_checks_its_endpoint_with_and_without_argparse(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["slave", "paper_field", "--listen", "tcp/127.0.0.1:99999", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("uuv-hil slave: --listen: endpoint 'tcp/127.0.0.1:99999' is not of the form tcp/HOST:PORT")


def test_every_output_file_is_checked_first() -> None:
    """The metavar of an option shows that it names a file to write."""
    texts = [
        option for option in OPTIONS if option.action.dest in ("output", "plot")
        and str(option.action.metavar).startswith("FILE") and option.action.metavar != "FILE|DIR"
    ]  # fmt: skip
    assert len(texts) >= 12
    assert {option.name for option in texts if option.action.type is not parser.OUTPUT_FILE} == set()
