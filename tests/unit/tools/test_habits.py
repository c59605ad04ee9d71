"""What CI and the tests keep to: pinned actions, every Python that is promised, few tests that repeat themselves."""

import re
from pathlib import Path

import pytest

from tests.support.processes import ROOT

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
TEST_FILES = sorted((ROOT / "tests").rglob("*.py"))


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_actions_are_pinned_by_their_digest(path: Path) -> None:
    actions = re.findall(r"uses: (\S+)(.*)", path.read_text())
    assert actions
    for action, version in actions:
        assert re.search("@[0-9a-f]{40}$", action), action
        assert re.match(r" # v\d", version), action


def test_ci_runs_every_python_of_the_classifiers() -> None:
    promised = re.findall(r"Python :: (3\.\d+)", (ROOT / "pyproject.toml").read_text())
    (tried,) = re.findall(r"python: \[(.*)\]", (ROOT / ".github" / "workflows" / "check.yml").read_text())
    assert re.findall(r"3\.\d+", tried) == promised


def test_few_tests_repeat_their_attempt() -> None:
    uses = {path: len(re.findall(r"(?<!def )retr(?:y|ied)_when_busy\(", path.read_text())) for path in TEST_FILES}
    uses[ROOT / "tests" / "support" / "busy.py"] = 0
    repeated = [path for path, count in uses.items() for _ in range(count)]
    assert len(repeated) <= 10
    assert not [path for path in repeated if ROOT / "tests" / "unit" in path.parents]
