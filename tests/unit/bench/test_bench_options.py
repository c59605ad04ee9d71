"""The options that benchmarks share: outputs are tried before anything is measured, and nothing is left of it."""

from argparse import Namespace
from pathlib import Path

import pytest

from hil.bench.record import Figure, load, new_record
from hil.commands.bench.options import check_outputs, save_record
from hil.common.errors import ConfigError


def outputs(**paths: Path) -> Namespace:
    return Namespace(**{name: str(path) for name, path in paths.items()})


def test_an_output_is_tried_and_not_left_behind(tmp_path: Path) -> None:
    check_outputs(outputs(output=tmp_path / "a.json", csv=tmp_path / "new" / "a.csv"))
    assert not (tmp_path / "a.json").exists()
    assert list((tmp_path / "new").iterdir()) == []


def test_an_earlier_output_is_kept_until_there_is_another(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text("earlier")
    check_outputs(outputs(output=path))
    assert path.read_text() == "earlier"
    save_record(new_record("table", {}, {"x": Figure([1.0], "s")}), outputs(output=path))
    assert load(str(path)).figures["x"].values == [1.0]


def test_outputs_that_are_not_asked_for() -> None:
    check_outputs(Namespace())
    check_outputs(Namespace(output=None, csv=None, markdown=None, plot=None))


@pytest.mark.parametrize("name", ["output", "csv", "markdown", "plot"])
@pytest.mark.parametrize(
    ("place", "reason"),
    [("folder", "Is a directory"), ("file/a.json", "its folder is a file"), ("file/more/a.json", "Not a directory")],
)
def test_an_output_that_cannot_be(tmp_path: Path, name: str, place: str, reason: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match=f"cannot be written: {reason}; name a file in a folder of yours"):
        check_outputs(outputs(**{name: tmp_path / place}))
