"""Each statement of the status page names tests that exist, and a run tells the page when they passed."""

import ast
import json
import re
from functools import cache
from pathlib import Path

import pytest

from tools.reference import status

ROOT = Path(__file__).parents[3]
EXPLANATION = "".join(page.read_text(encoding="utf-8") for page in sorted((ROOT / "docs/explanation").glob("*.md")))
CASE = '<testcase classname="tests.unit.test_a" name="{}">{}</testcase>'


@cache
def functions_of(path: str) -> frozenset[str]:
    """Return the names of the test functions of a file."""
    tree = ast.parse((ROOT / path).read_text())
    return frozenset(node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


def test_each_named_test_exists() -> None:
    tried, pages = status.statements()
    rows = [row for sections in pages.values() for rows in sections.values() for row in rows]
    assert all(row.tests for row in rows)
    assert len(rows) > 80
    named = [test for tests in (*(row.tests for row in rows), *(row.tests for row in tried)) for test in tests]
    for name in (*named, *re.findall(r"`(tests/[\w/]+\.py(?:::\w+)?)`", EXPLANATION)):
        path, _, test = name.partition("::")
        assert (ROOT / path).is_file(), f"a page names {path}"
        assert not test or test in functions_of(path), f"a page names {name}"


def test_a_run_dates_the_tests_that_passed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = ["tests/unit/test_a.py", *(f"tests/unit/test_a.py::test_{name}" for name in ("good", "bad", "absent"))]
    results = tmp_path / "status.json"
    results.write_text(json.dumps(dict.fromkeys(names, "2026-01-01")))
    monkeypatch.setattr(status, "RESULTS", results)
    monkeypatch.setattr(status, "_all", lambda: [tuple(names)])
    cases = [CASE.format("test_good[1]", ""), CASE.format("test_good[2]", "<properties/>"),
             CASE.format("test_bad[1]", ""), CASE.format("test_bad[2]", "<failure/>"),
             CASE.format("test_absent", "<skipped/>"), CASE.format("test_unnamed", "")]  # fmt: skip
    (tmp_path / "test.xml").write_text(f"<testsuites><testsuite>{''.join(cases)}</testsuite></testsuites>")
    status.merge(tmp_path, "2026-02-03")
    failed = "failed on 2026-02-03"
    assert json.loads(results.read_text()) == dict(
        zip(names, (failed, "2026-02-03", failed, "2026-01-01"), strict=True)
    )
