"""Text is UTF-8 wherever it is read or written, whatever the machine's locale is."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("hil", "sim", "boards", "firmware_stub", "tools")
# Modules whose `open` is of other things
ELSEWHERE = {"os", "memory", "webbrowser", "zenoh", "rasterio", "laspy", "Image"}
PACKED = {"gzip", "lzma", "bz2"}  # binary by default
MODES = {"open": 1, "fdopen": 1, "read_text": -1, "write_text": -1}  # function -> where its mode is, -1: no mode


def text_without_encoding(source: str) -> Iterator[int]:
    """Yield the lines of a module that open a file as text and leave the encoding to the locale."""
    if not any(f"{place}(" in source for place in MODES):  # parsing all modules takes seconds
        return
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call):
            continue
        function = node.func
        name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
        owner = getattr(function.value, "id", "") if isinstance(function, ast.Attribute) else ""
        if name not in MODES or (name == "open" and owner in ELSEWHERE):
            continue
        place = 0 if name == "open" and isinstance(function, ast.Attribute) and owner not in PACKED else MODES[name]
        modes = [keyword.value for keyword in node.keywords if keyword.arg == "mode"]
        modes += node.args[place : place + 1] if place >= 0 else []
        mode = modes[0].value if modes and isinstance(modes[0], ast.Constant) else "r" if owner not in PACKED else "rb"
        if "b" not in str(mode) and not any(keyword.arg == "encoding" for keyword in node.keywords):
            yield node.lineno


@pytest.mark.parametrize(
    ("source", "is_found"),
    [
        ("open(p)", True), ("open(p, 'w')", True), ("open(p, mode='a')", True), ("os.fdopen(d, 'w')", True),
        ("path.open()", True), ("path.open('w')", True), ("path.read_text()", True), ("path.write_text(t)", True),
        ("gzip.open(p, 'rt')", True),
        ("open(p, 'rb')", False), ("open(p, encoding='utf-8')", False), ("path.open('wb')", False),
        ("os.open(p, 0)", False),
        ("path.read_text(encoding='utf-8')", False), ("gzip.open(p)", False), ("os.fdopen(d, 'wb')", False),
    ],
)  # fmt: skip
def test_calls_without_an_encoding_are_found(source: str, is_found: bool) -> None:
    assert bool(list(text_without_encoding(source))) == is_found


def test_no_file_is_opened_with_the_locales_encoding() -> None:
    problems = [
        f"{path.relative_to(ROOT)}:{line}"
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        for line in text_without_encoding(path.read_text(encoding="utf-8"))
    ]
    assert not problems, f"give encoding= to {', '.join(problems)}"
