"""The slave's own parsing of its command line, which is faster than argparse and has the same result."""

import itertools

import pytest

from hil.commands.slave import _parse, _parse_plain

VALUES = {
    "--listen": ("tcp/a:1", "tcp/b:2"),
    "--board": ("x", "y"),
    "--port": ("/dev/a", "pty:"),
    "--member": ("1", "2"),
}


@pytest.mark.parametrize("first", VALUES)
@pytest.mark.parametrize("second", VALUES)
def test_the_last_of_repeated_options_applies_as_with_argparse(first: str, second: str) -> None:
    arguments = ["paper_field", first, VALUES[first][0], second, VALUES[second][1]]
    parsed = _parse_plain(arguments)
    assert parsed is not None
    assert parsed == _parse(arguments)
    assert vars_of(parsed)[second[2:]] == VALUES[second][1]


@pytest.mark.parametrize("options", list(itertools.permutations(VALUES, 3)))
def test_options_may_have_any_order(options: tuple[str, ...]) -> None:
    words = ["paper_field", *[word for name in options for word in (name, VALUES[name][0])]]
    assert _parse_plain(words) == _parse(words)


@pytest.mark.parametrize("args", [["--port", "x", "paper_field"], ["paper_field", "--port=x"], ["a", "--port", "-x"]])
def test_unusual_command_lines_are_left_to_argparse(args: list[str]) -> None:
    assert _parse_plain(args) is None


def vars_of(options: object) -> dict[str, str]:
    return options._asdict() if hasattr(options, "_asdict") else vars(options)
