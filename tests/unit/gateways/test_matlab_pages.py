"""The reference page of the MATLAB and Octave package documents every public name, and no other."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[3]
PACKAGE = ROOT / "hil" / "gateways" / "matlab" / "+uuv"
PAGE = (ROOT / "docs" / "reference" / "matlab.md").read_text()
BLOCK = re.compile(r"^  methods(.*?)^  end", re.MULTILINE | re.DOTALL)
FUNCTION = re.compile(r"^    function (?:[^=\n]+ = )?(\w+)", re.MULTILINE)


def public_methods(name: str) -> set[str]:
    """Return names of the public methods of a class, without its constructor."""
    parts = [block for block in BLOCK.findall((PACKAGE / f"{name}.m").read_text()) if "private" not in block[:30]]
    return {method for part in parts for method in FUNCTION.findall(part)} - {name}


def section(title: str) -> str:
    return PAGE.partition(f"## {title}\n")[2].partition("\n## ")[0]


def test_the_page_lists_all_methods_of_a_vehicle() -> None:
    named = set(re.findall(r"(\w+)\(", section("uuv.Vehicle"))) - {"Vehicle"}
    assert named == public_methods("Vehicle") - {"numbers"}  # which serves the others
    assert len(named) >= 25


def test_the_page_lists_all_methods_of_a_gateway() -> None:
    named = set(re.findall(r"`(\w+)\(", section("uuv.Gateway")))
    assert named == public_methods("Gateway") - {"one_line"}


def test_the_page_lists_all_functions_classes_and_errors() -> None:
    assert {path.stem for path in PACKAGE.glob("*.m")} == set(re.findall(r"uuv\.(\w+)", PAGE))
    raised = {name for path in PACKAGE.glob("*.m") for name in re.findall(r"'uuv:(\w+)'", path.read_text())}
    assert raised - {"picture", "beams"} == set(re.findall(r"`uuv:(\w+)`", section("Errors")))


def test_the_pages_name_every_file_of_the_template() -> None:
    page = (ROOT / "docs" / "how-to" / "matlab.md").read_text()
    assert {path.name for path in (PACKAGE.parent / "template").glob("*.m")} == set(re.findall(r"`(\w+\.m)`", page))
