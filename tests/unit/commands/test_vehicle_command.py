"""`uuv-hil vehicle` as a person and a program see its output."""

import json
from pathlib import Path

import pytest

from hil.cli import main
from sim.vehicle.vehicle import load_vehicle

VECTORS = Path(__file__).parents[2] / "vectors"


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = main(["vehicle", *arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_json_output_has_the_same_figures(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = run(capsys, "paper_six", "--json")
    table = json.loads(out)
    assert table["mass"] == 9.7
    assert (table["rank"], table["not_driven"]) == (5, ["pitch"])
    assert [len(table["wrench_matrix"]), len(table["wrench_matrix"][0])] == [6, 6]
    assert table["reach"]["surge"]["speed"][0] == pytest.approx(2.208, abs=1e-3)


def test_the_plot_is_a_png_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = pytest.importorskip("matplotlib.image")
    path = tmp_path / "seven.png"
    code, _, _ = run(capsys, "paper_seven", "--plot", str(path))
    pixels = image.imread(path)
    assert code == 0
    assert pixels.shape[0] > 800
    assert pixels[..., :3].std() > 0.05  # something is drawn
    assert run(capsys, "paper_seven", "--plot", str(tmp_path / "a.nonsense"))[0] == 2


def test_import_writes_a_vehicle_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "mine.toml"
    code, out, _ = run(capsys, "--import", str(VECTORS / "hydra.urdf"), "-o", str(path))
    assert (code, out) == (0, f"{path}: hydra, 30 kg, 3 thrusters\n")
    code, out, _ = run(capsys, str(path))
    assert code == 0
    assert "cannot be driven alone: sway, roll, pitch, yaw" in out


def test_import_writes_both_files_or_neither(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, flight = tmp_path / "mine.toml", tmp_path / "folder"
    flight.mkdir()
    for bad in (flight, Path("/proc/no/flight.toml")):
        code, _, err = run(capsys, "--import", str(VECTORS / "hydra.urdf"), "-o", str(path), "--flight", str(bad))
        assert (code, f"{bad}: cannot be written" in err) == (2, True)
        assert list(tmp_path.iterdir()) == [flight]


def test_import_lists_missing_keys_and_accepts_them_from_a_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = run(capsys, "--import", str(VECTORS / "hydra_gz.urdf"))
    assert code == 2
    assert "does not say volume" in err
    missing_keys = tmp_path / "rest.toml"
    missing_keys.write_text(
        "volume = 0.024\ndimensions = [0.6, 0.4, 0.35]\ncenter_of_buoyancy = [0, 0, -0.05]\n"
        '[every_thruster]\nmax_forward = "60 N"\nmax_reverse = "45 N"\n'
    )
    code, out, _ = run(capsys, "--import", str(VECTORS / "hydra_gz.urdf"), "--add", str(missing_keys))
    (tmp_path / "gz.toml").write_text(out)
    assert code == 0
    assert load_vehicle(str(tmp_path / "gz.toml"))[0].thrusters[0].max_reverse == 45.0


@pytest.mark.parametrize(
    ("arguments", "expected_text"),
    [
        (["bluerov"], "did you mean 'bluerov2'"),
        (["paper_six", "-o", "a.toml"], "go with --import"),
        (["--import", "nowhere.urdf"], "nowhere.urdf: no such file"),
    ],
)
def test_every_error_is_one_line(arguments: list[str], expected_text: str, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("uuv-hil vehicle: ")
    assert expected_text in err
    assert err.count("\n") == 1


def test_a_vehicle_written_as_urdf_can_be_imported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["vehicle", "paper_six", "--urdf", "--prefix", "uuv1/"]) == 0
    urdf = tmp_path / "written.urdf"
    urdf.write_text(capsys.readouterr().out)
    assert main(["vehicle", "--import", str(urdf), "-o", str(tmp_path / "back.toml")]) == 0
    assert load_vehicle(str(tmp_path / "back.toml"))[0].added_mass == load_vehicle("paper_six")[0].added_mass
