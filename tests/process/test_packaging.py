"""The wheel holds exactly the four packages, with their data."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    environment = os.environ | {"UUV_HIL_NATIVE": "0"}  # what is compiled is tested in sim/native/test_native.py
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    (path,) = folder.glob("uuv_hil-*.whl")
    return zipfile.ZipFile(path).namelist()


def test_top_level_names(wheel: list[str]) -> None:
    top = {name.split("/")[0] for name in wheel}
    assert {name for name in top if not name.endswith(".dist-info")} == {"hil", "sim", "boards", "firmware_stub"}


@pytest.mark.parametrize(
    "folder", ["boards", "sim/vehicles", "sim/worlds", "firmware_stub/frames", "hil/scenario/presets"]
)
def test_every_data_file_is_inside(wheel: list[str], folder: str) -> None:
    files = [path.relative_to(ROOT).as_posix() for path in (ROOT / folder).glob("*.toml")]
    assert files, f"no TOML in {folder}"
    assert set(files) <= set(wheel)


def test_types_are_announced(wheel: list[str]) -> None:
    assert {f"{package}/py.typed" for package in ("hil", "sim", "boards", "firmware_stub")} <= set(wheel)
