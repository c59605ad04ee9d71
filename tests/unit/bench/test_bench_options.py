"""The options that benchmarks share: a record replaces an earlier one only once it is complete."""

from argparse import Namespace
from pathlib import Path

from hil.bench.record import Figure, load
from hil.commands.bench.options import save_record


def test_a_new_record_replaces_an_earlier_output_file(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text("earlier")
    save_record("table", Namespace(output=str(path), seconds=2.0), {"x": Figure([1.0], "s")}, ())
    record = load(str(path))
    assert record.figures["x"].values == [1.0]
    assert record.settings == {"seconds": 2.0}
