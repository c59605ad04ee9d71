"""`uuv-hil tune` as a command: the table, the file that a scenario can use, the picture, and its errors."""

from pathlib import Path

import pytest

from hil import cli
from hil.autonomy.control.controller import Gains
from hil.common.schema import parse
from sim.vehicle.vehicle import load_vehicle


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    code = cli.main(["tune", *map(str, arguments)])
    out = capsys.readouterr()
    return code, out.out, out.err


def test_tune_prints_a_table_and_writes_a_vehicle_file_and_a_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output, picture = tmp_path / "tuned.toml", tmp_path / "steps.png"
    code, out, err = run(capsys, "paper_six", "--axis", "heave", "--axis", "depth", "-o", output, "--plot", picture)
    assert (code, err) == (0, "")
    assert out.splitlines()[1].split()[:4] == ["heave", "0.30", "m/s", "before"]
    assert picture.read_bytes()[:4] == b"\x89PNG"
    tuned, control = load_vehicle(str(output))
    preset, old = load_vehicle("paper_six")
    assert tuned == preset
    new, before = parse(control, Gains, ""), parse(old, Gains, "")
    assert new.heave != before.heave
    assert new.surge == before.surge
    code, out, _ = run(capsys, output, "--axis", "surge")  # the vehicle can be flown
    assert code == 0
