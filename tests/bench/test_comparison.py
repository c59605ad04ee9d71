"""`uuv-hil bench compare`: real differences are found, chance is not, and what is no result is refused."""

import json
import random
from pathlib import Path

import pytest

from hil.bench.comparison import compare, difference
from hil.bench.record import Figure, Record, load, new_record, save
from hil.cli import main
from hil.errors import ConfigError


def values(middle: float, seed: int, count: int = 30, scatter: float = 0.1) -> list[float]:
    generator = random.Random(seed)
    return [middle * (1.0 + generator.gauss(0.0, scatter)) for _ in range(count)]


def write(path: Path, **figures: Figure) -> str:
    save(new_record("table", {"repeat": 30}, figures), str(path))
    return str(path)


@pytest.mark.parametrize(
    ("after", "better", "verdict"),
    [
        (1.3, "lower", "worse"),
        (1.3, "higher", "better"),
        (0.7, "lower", "better"),
        (0.7, "higher", "worse"),
        (1.3, "", "changed"),
        (1.0, "lower", "same"),
    ],
)
def test_verdicts(after: float, better: str, verdict: str) -> None:
    before = Figure(values(1.0, 1), "ms", better)  # type: ignore[arg-type]
    found = difference("x", before, before._replace(values=values(after, 2)), 0.05, 0.95)
    assert found.verdict == verdict
    assert found.interval.holds(found.ratio)
    assert found.ratio == pytest.approx(after, rel=0.1)


def test_a_real_difference_that_does_not_matter_is_none() -> None:
    before, after = Figure(values(1.0, 1, 400, 0.001), "ms"), Figure(values(1.02, 2, 400, 0.001), "ms")
    assert difference("x", before, after, 0.05, 0.95).verdict == "same"
    assert difference("x", before, after, 0.01, 0.95).verdict == "worse"


def test_chance_is_seldom_taken_for_real() -> None:
    pairs = [(Figure(values(1.0, seed), "ms"), Figure(values(1.0, seed + 1000), "ms")) for seed in range(40)]
    wrong = [pair for pair in pairs if difference("x", *pair, 0.0, 0.95).verdict != "same"]
    assert len(wrong) <= 6


def test_few_values_prove_nothing() -> None:
    assert difference("x", Figure([1.0] * 4, "ms"), Figure([9.0] * 40, "ms"), 0.05, 0.95).verdict == "too few"


def test_a_median_of_zero() -> None:
    nothing, something = Figure([0.0] * 9, ""), Figure([2.0] * 9, "")
    assert difference("losses", nothing, something, 0.05, 0.95).verdict == "worse"
    assert difference("losses", nothing, nothing, 0.05, 0.95).verdict == "same"


def test_only_common_figures_are_compared() -> None:
    one, two = (Record("table", {}, {name: Figure([1.0] * 5, "s"), "both": Figure([1.0] * 5, "s")}) for name in "ab")
    assert [found.name for found in compare(one, two)] == ["both"]


def test_the_exit_code_for_continuous_integration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = write(tmp_path / "a.json", delay=Figure(values(0.5, 1), "ms"))
    after = write(tmp_path / "b.json", delay=Figure(values(0.8, 2), "ms"))
    assert main(["bench", "compare", before, after]) == 0
    assert main(["bench", "compare", before, after, "--fail-on-regression"]) == 1
    assert "worse" in capsys.readouterr().out
    assert main(["bench", "compare", after, before, "--fail-on-regression"]) == 0
    assert main(["bench", "compare", before, after, "--fail-on-regression", "--least", "90%"]) == 0
    capsys.readouterr()
    assert main(["bench", "compare", before, after, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["differences"]
    assert rows[0]["verdict"] == "worse"
    assert rows[0]["interval"][0] > 1.0


def test_a_record_is_read_as_it_was_written(tmp_path: Path) -> None:
    figures = {"delay": Figure([0.1, float("nan"), 0.3], "ms"), "rate": Figure([], "Hz", "higher")}
    record = new_record("table", {"repeat": 3}, figures, ["limited: processor 0 only"], {"more": float("inf")})
    save(record, str(tmp_path / "a.json"))
    read = load(str(tmp_path / "a.json"))
    assert read.figures == {"delay": Figure([0.1, 0.3], "ms"), "rate": Figure([], "Hz", "higher")}
    assert read.labels == record.labels
    assert "limited: processor 0 only" in read.labels
    assert read.machine["cores"] >= 1
    assert read.details == {"more": None}


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"format": "uuv-hil bench 1"}', '{"format": "other"}', "\x00"])
def test_what_is_no_result(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"a\.json: is not a result"):
        load(str(path))


def test_what_cannot_be_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, other = write(tmp_path / "a.json", a=Figure([1.0], "s")), write(tmp_path / "b.json", b=Figure([1.0], "s"))
    assert main(["bench", "compare", one, other]) == 2
    assert main(["bench", "compare", one, str(tmp_path / "none.json")]) == 2
    assert main(["bench", "compare", one, one, "--least", "much"]) == 2
    said = capsys.readouterr().err
    assert all(word in said for word in ("no figure in common", "none.json: cannot be read", "--least 'much'"))
