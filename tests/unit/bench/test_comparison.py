"""`uuv-hil bench compare`: real differences are found, random ones are not, and invalid results are refused."""

import json
import random
from pathlib import Path

import pytest

from hil.bench.comparison import compare, difference, different_conditions
from hil.bench.record import Better, Figure, Record, load, new_record, save
from hil.cli import main
from hil.common.errors import ConfigError

NAN = float("nan")


def values(middle: float, seed: int, count: int = 30, scatter: float = 0.1) -> list[float]:
    generator = random.Random(seed)
    return [middle * (1.0 + generator.gauss(0.0, scatter)) for _ in range(count)]


def figure_of_starts(values: list[float], unit: str = "ms", better: Better = "lower") -> Figure:
    """Return a figure with one value for each start."""
    return Figure(values, unit, better, (1,) * len(values))


def figure_of_runs(seed: str, count: int, size: int, middle: float = 20.0) -> Figure:
    """Return a figure of starts that differ, each with correlated values of commands: AR(1), 0.5."""
    generator, samples = random.Random(seed), []
    for _ in range(count):
        state, offset = 0.0, generator.gauss(0.0, 1.0)
        for _ in range(size):
            state = 0.5 * state + generator.gauss(0.0, 1.0)
            samples.append(middle + offset + state)
    return Figure(samples, "ms", "lower", (size,) * count)


def write(path: Path, kind: str = "table", **figures: Figure) -> str:
    save(new_record(kind, {"repeat": 30}, figures), str(path))
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
def test_a_difference_has_the_expected_verdict(after: float, better: Better, verdict: str) -> None:
    before = figure_of_starts(values(1.0, 1), "ms", better)
    change = difference("x", before, before._replace(values=values(after, 2)), 0.05, 0.95)
    assert change.verdict == verdict
    assert change.interval.holds(change.ratio)
    assert change.ratio == pytest.approx(after, rel=0.1)


def test_a_real_difference_below_the_threshold_is_reported_as_same() -> None:
    before, after = figure_of_starts(values(1.0, 1, 400, 0.001)), figure_of_starts(values(1.02, 2, 400, 0.001))
    assert difference("x", before, after, 0.05, 0.95).verdict == "same"
    assert difference("x", before, after, 0.01, 0.95).verdict == "worse"


def test_random_differences_are_seldom_reported_as_real() -> None:
    pairs = [(figure_of_starts(values(1.0, seed)), figure_of_starts(values(1.0, seed + 1000))) for seed in range(40)]
    wrong = [pair for pair in pairs if difference("x", *pair, 0.0, 0.95).verdict != "same"]
    assert len(wrong) <= 6


def test_starts_count_as_independent_samples_and_commands_do_not() -> None:
    """Five starts of one program against five more are nearly never a real difference, though their commands differ."""
    pairs = [(figure_of_runs(f"a{seed}", 5, 40), figure_of_runs(f"b{seed}", 5, 40)) for seed in range(60)]
    wrong = [pair for pair in pairs if difference("x", *pair, 0.0, 0.95).verdict != "same"]
    assert len(wrong) <= 6, "some 3 of 60 are nominal"
    slower = [
        difference("x", figure_of_runs(f"a{seed}", 5, 40), figure_of_runs(f"b{seed}", 5, 40, 26.0), 0.0, 0.95)
        for seed in range(9)
    ]
    assert {found.verdict for found in slower} == {"worse"}


def test_two_single_starts_are_never_reported_as_better_or_worse(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil.bench.statistics.RESAMPLES", 400)  # for speed
    pairs = [(figure_of_runs(f"a{seed}", 1, 200), figure_of_runs(f"b{seed}", 1, 200)) for seed in range(30)]
    verdicts = [difference("x", *pair, 0.0, 0.95).verdict for pair in pairs]
    assert set(verdicts) == {"same", "few starts"}
    assert verdicts.count("few starts") > 10, "starts do differ"
    without_runs = [figure._replace(runs=()) for figure in pairs[0]]
    assert difference("x", without_runs[0], without_runs[1], 0.0, 0.95).verdict == verdicts[0], "an old file"
    assert (
        difference("x", figure_of_runs("a", 4, 9), figure_of_runs("b", 9, 9, 40.0), 0.0, 0.95).verdict == "few starts"
    )


def test_a_table_counts_one_value_a_start() -> None:
    """A record without `runs` counts one value a start too."""
    before, after = (Figure(values(middle, 1), "s") for middle in (1.0, 2.0))
    verdict = {
        kind: compare(Record(kind, {}, {"x": before}), Record(kind, {}, {"x": after}))[0].verdict
        for kind in ("table", "startup", "delay")
    }
    assert verdict == {"table": "worse", "startup": "worse", "delay": "few starts"}


def test_few_values_give_no_verdict() -> None:
    assert difference("x", Figure([1.0] * 4, "ms"), Figure([9.0] * 40, "ms"), 0.05, 0.95).verdict == "too few"
    assert difference("x", figure_of_starts([1.0] * 4), figure_of_starts([9.0] * 40), 0.05, 0.95).verdict == "too few"


def test_differences_from_a_median_of_zero_have_a_direction() -> None:
    unused, used = figure_of_starts([0.0] * 9), figure_of_starts([2.0] * 9)
    assert difference("losses", unused, used, 0.05, 0.95).verdict == "worse"
    assert difference("losses", used, unused, 0.05, 0.95).verdict == "better"
    assert difference("losses", unused, unused, 0.05, 0.95).verdict == "same"


@pytest.mark.parametrize(("before", "after"), [(-2.0, -1.0), (-1.0, 1.0), (-1.0, -0.5)])
def test_negative_medians_have_a_direction_too(before: float, after: float) -> None:
    one, other = figure_of_starts([before] * 9), figure_of_starts([after] * 9)
    assert difference("x", one, other, 0.05, 0.95).verdict == "worse"
    assert difference("x", other, one, 0.05, 0.95).verdict == "better"
    assert difference("x", one, figure_of_starts([before * 1.01] * 9), 0.05, 0.95).verdict == "same"


def test_only_common_figures_are_compared() -> None:
    one, two = (Record("table", {}, {name: Figure([1.0] * 5, "s"), "both": Figure([1.0] * 5, "s")}) for name in "ab")
    assert [found.name for found in compare(one, two)] == ["both"]


def test_a_regression_sets_the_exit_code(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
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


def test_a_record_is_read_back_equal(tmp_path: Path) -> None:
    figures = {"delay": Figure([0.1, NAN, 0.3, NAN], "ms", runs=(1, 2, 1)), "rate": Figure([], "Hz", "higher")}
    record = new_record("table", {"repeat": 3}, figures, ["limited: processor 0 only"], {"more": float("inf")})
    save(record, str(tmp_path / "a.json"))
    read = load(str(tmp_path / "a.json"))
    assert read.figures == {"delay": Figure([0.1, 0.3], "ms", runs=(1, 1)), "rate": Figure([], "Hz", "higher")}
    assert read.labels == record.labels
    assert "limited: processor 0 only" in read.labels
    assert read.machine["cores"] >= 1
    assert read.details == {"more": None}


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"format": "uuv-hil bench 1"}', '{"format": "other"}', "\x00"])
def test_files_that_are_not_results_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"a\.json: is not a result"):
        load(str(path))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("machine", None),
        ("settings", None),
        ("details", 1),
        ("labels", [1, 2]),
        ("kind", 3),
        ("more", 1),
    ],
)
def test_a_field_of_a_wrong_type_is_refused(tmp_path: Path, key: str, value: object) -> None:
    path = write(tmp_path / "a.json", x=Figure([1.0], "s"))
    damage(path, key, value)
    with pytest.raises(ConfigError, match=r"a\.json: is not a result"):
        load(path)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("values", [10**400]),
        ("values", [NAN]),
        ("values", [None]),
        ("unit", 3),
        ("better", "more"),
        ("runs", [2]),
        ("runs", [2, -1]),
    ],
)
def test_a_malformed_figure_is_refused(tmp_path: Path, key: str, value: object) -> None:
    path = write(tmp_path / "a.json", x=Figure([1.0], "s"))
    damage(path, key, value, "figures", "x")
    with pytest.raises(ConfigError, match=r"a\.json: is not a result"):
        load(path)


def damage(path: str, key: str, value: object, *parents: str) -> None:
    root = table = json.loads(Path(path).read_text())
    for name in parents:
        table = table[name]
    table[key] = value
    Path(path).write_text(json.dumps(root))


def test_older_files_without_run_counts_are_read(tmp_path: Path) -> None:
    path = write(tmp_path / "a.json", x=Figure([1.0, 2.0], "s"))
    table = json.loads(Path(path).read_text())
    del table["figures"]["x"]["runs"]
    Path(path).write_text(json.dumps(table))
    assert load(path).figures == {"x": Figure([1.0, 2.0], "s")}


def test_differences_between_machines_are_listed() -> None:
    record = Record(
        "table",
        {"repeat": 5},
        {},
        machine={
            "load": 0.4, "governors": {"performance": 4}, "python": "3.11.2", "packages": {"eclipse-zenoh": "1.2"}
        },
    )  # fmt: skip
    other = Record(
        "table",
        {"repeat": 5},
        {},
        ("virtual machine",),
        machine={
            "load": 3.1, "governors": {"powersave": 4}, "python": "3.11.2",
            "packages": {"eclipse-zenoh": "1.3", "numpy": "2.0"},
        },
    )  # fmt: skip
    assert different_conditions(record, record) == []
    assert different_conditions(record, other) == [
        "governors of the machine: performance (4) and powersave (4)",
        "load of the machine: 0.4 and 3.1",
        "eclipse-zenoh: 1.2 and 1.3",
        "numpy: none and 2.0",
        "labels: none and virtual machine",
    ]
    assert different_conditions(record, record._replace(machine={**record.machine, "load": 0.9})) == [], (
        "values always vary a little"
    )
    assert different_conditions(record, record._replace(machine={**record.machine, "load": "much"})) == []


def test_results_of_different_benchmarks_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one = write(tmp_path / "a.json", "table", a=Figure([1.0], "s"))
    other = write(tmp_path / "b.json", "delay", b=Figure([1.0], "s"))
    assert main(["bench", "compare", one, other]) == 2
    assert "a.json is of `bench table`, " in (output := capsys.readouterr().err)
    assert "b.json of `bench delay`: they have no figure in common; give two results of one benchmark" in output
