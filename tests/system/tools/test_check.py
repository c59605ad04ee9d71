"""`tools/check.py`: a test that fails once is repeated and reported; one that fails twice and any other error fail."""

from pathlib import Path

import pytest

from tools import check

BY_CHANCE = """
from pathlib import Path
def test_by_chance():
    first = not Path("been").exists()
    Path("been").touch()
    assert not first
"""
NEVER = "def test_never(): assert False\n"
FINE = "def test_fine(): pass\n"
TEARDOWN = """
import pytest
@pytest.fixture
def left():
    yield
    raise OSError("left open")
def test_leaves(left): pass
"""


@pytest.fixture(autouse=True)
def _fewer_plugins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Load the plugin alone that the part's arguments need: pytest starts in half the time."""
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.setenv("PYTEST_PLUGINS", "xdist.plugin")


def outcome(folder: Path, *files: str, jobs: str = "0", again: int = 2) -> tuple[list[str], list[str]]:
    for number, text in enumerate(files):
        (folder / f"test_{number}.py").write_text(text)
    return check.run_tests(["."], ["-n", jobs], folder, again)


def test_a_test_that_fails_once_passes_and_is_reported(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    failed, passed_alone = outcome(tmp_path, BY_CHANCE, FINE, jobs="1")
    assert (failed, passed_alone) == ([], ["test_0.py::test_by_chance"])
    assert "1 failed beside others; once more, alone:\n  test_0.py::test_by_chance" in capfd.readouterr().out
    reported = check.summary(
        {"test": check.Outcome(3.0, failed, passed_alone), "lint": check.Outcome(1.0, ["mypy"], [])}
    )
    assert reported.splitlines() == [
        "test     passed in 3 s",
        "lint     FAILED in 1 s",
        "  failed: mypy",
        "passed in a second attempt, alone (1 of at most 2; to be corrected):",
        "  test     test_0.py::test_by_chance",
    ]


def test_a_test_that_fails_twice_fails(tmp_path: Path) -> None:
    expected = ["test_1.py::test_leaves"], ["test_0.py::test_by_chance"]
    assert outcome(tmp_path, BY_CHANCE, TEARDOWN) == expected


def test_more_failures_than_second_attempts_are_left_fail_at_once(tmp_path: Path) -> None:
    failed = ["test_0.py::test_by_chance", "test_1.py::test_never"]
    assert outcome(tmp_path, BY_CHANCE, NEVER, again=1) == (failed, [])


def test_tests_beside_a_part_never_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    files = [tmp_path / "test_part.py", tmp_path / "test_beside.py"]
    for file, text in zip(files, (FINE, NEVER), strict=True):
        file.write_text(text)
    monkeypatch.setitem(check.PARTS, "two", check.Part((str(files[0]),), beside=(str(files[1]),)))
    result = check.run_part("two", 1, 1)
    assert [name.rpartition("::")[2] for name in result.failed] == ["test_never"]
    assert result.passed_alone == []
    assert capfd.readouterr().out.count("1 failed in") == 1, "what ran beside is printed, once"


def test_a_whole_run_has_two_second_attempts(monkeypatch: pytest.MonkeyPatch) -> None:
    left = []

    def run_part(name: str, jobs: int | None, seed: int, again: int, _: str) -> check.Outcome:
        left.append(again)
        return check.Outcome(0.0, [], ["one"] * (name != "lint"))

    monkeypatch.setattr(check, "run_part", run_part)
    assert check.main(["test", "lint", "search", "system"]) == 0
    assert left == [2, 1, 1, 0]


@pytest.mark.parametrize("text", ["import nothing_of_that_name\n", ""], ids=["not collected", "no test"])
def test_an_error_of_collection_fails(tmp_path: Path, text: str) -> None:
    failed, passed_alone = outcome(tmp_path, text)
    assert failed
    assert passed_alone == []
