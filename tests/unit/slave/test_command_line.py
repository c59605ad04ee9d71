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


@pytest.mark.parametrize(
    "options", [*itertools.permutations(VALUES, 3), *itertools.product(VALUES, repeat=2)], ids=" ".join
)
def test_options_in_any_order_and_repeated_apply_as_with_argparse(options: tuple[str, ...]) -> None:
    words = ["paper_field", *[word for n, name in enumerate(options) for word in (name, VALUES[name][n % 2])]]
    assert _parse_plain(words) is not None
    assert _parse_plain(words) == _parse(words)


@pytest.mark.parametrize("args", [["--port", "x", "paper_field"], ["paper_field", "--port=x"], ["a", "--port", "-x"]])
def test_unusual_command_lines_are_left_to_argparse(args: list[str]) -> None:
    assert _parse_plain(args) is None
