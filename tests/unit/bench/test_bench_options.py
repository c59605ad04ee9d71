"""The options that benchmarks share: records, which replace earlier ones only when there is another."""

from argparse import Namespace
from pathlib import Path

from hil.bench.record import Figure, load, new_record
from hil.commands.bench.options import save_record


def test_an_earlier_output_is_kept_until_there_is_another(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text("earlier")
    save_record(new_record("table", {}, {"x": Figure([1.0], "s")}), Namespace(output=str(path)))
    assert load(str(path)).figures["x"].values == [1.0]
