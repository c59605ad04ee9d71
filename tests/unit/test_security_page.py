"""Each statement of the security page names its tests; all tests that any page of the explanation names exist."""

import ast
import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "explanation"
PAGE = (FOLDER / "security.md").read_text(encoding="utf-8")
ALL = "".join(page.read_text(encoding="utf-8") for page in sorted(FOLDER.glob("*.md")))
NAMED = re.compile(r"`(tests/[\w/]+\.py)::(\w+)`")


@cache
def functions_of(path: str) -> frozenset[str]:
    """Return the names of the test functions of a file."""
    tree = ast.parse((ROOT / path).read_text())
    return frozenset(node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


def test_each_named_test_exists() -> None:
    for path, test in NAMED.findall(ALL):
        assert (ROOT / path).is_file(), f"a page names {path}"
        assert test in functions_of(path), f"a page names {path}::{test}"
        assert test.startswith("test_")


def test_every_statement_in_a_table_has_a_test() -> None:
    rows = re.findall(r"^\| (?!statement)([^|]+) \| ([^|]+) \|$", PAGE.partition("## An attacker on the network")[2],
                      flags=re.MULTILINE)  # fmt: skip
    assert len(rows) > 25
    for statement, tests in rows:
        assert NAMED.search(tests), f"docs/explanation/security.md: no test is named for: {statement}"
