"""The wheel has exactly the four packages, their data, and metadata for a package index."""

import os
import re
import subprocess
import sys
import zipfile
from email import message_from_bytes
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """Build the wheel from what the container's image is made of, where no C can be compiled."""
    folder, source = tmp_path_factory.mktemp("wheel"), tmp_path_factory.mktemp("source")
    for line in (ROOT / "boards/container/Containerfile").read_text().splitlines():
        if line.startswith("COPY ") and "/src/" in line:
            subprocess.run(["cp", "-r", *line.split()[1:-1], source], cwd=ROOT, check=True)
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    environment = os.environ | {"CC": "false", "UUV_HIL_NATIVE": ""}  # compiling is tested in sim/native/test_native.py
    done = subprocess.run(command, cwd=source, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    (path,) = folder.glob("uuv_hil-*.whl")
    return zipfile.ZipFile(path)


@pytest.fixture
def wheel(archive: zipfile.ZipFile) -> list[str]:
    return archive.namelist()


def test_the_wheel_has_the_four_packages(wheel: list[str]) -> None:
    top = {name.split("/")[0] for name in wheel}
    assert {name for name in top if not name.endswith(".dist-info")} == {"hil", "sim", "boards", "firmware_stub"}


@pytest.mark.parametrize(
    "folder", ["boards", "sim/vehicles", "sim/worlds", "firmware_stub/frames", "hil/scenario/presets"]
)
def test_every_data_file_is_in_the_wheel(wheel: list[str], folder: str) -> None:
    files = [path.relative_to(ROOT).as_posix() for path in (ROOT / folder).glob("*.toml")]
    assert files, f"no TOML in {folder}"
    assert set(files) <= set(wheel)


def test_the_description_for_an_index_has_only_absolute_links(archive: zipfile.ZipFile) -> None:
    (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
    metadata = message_from_bytes(archive.read(name))
    assert metadata["Description-Content-Type"] == "text/markdown"
    text = metadata.get_payload()
    assert isinstance(text, str)
    assert text.startswith("# uuv-hil\n")
    assert "## Limits" in text
    assert all(link.startswith("https://") for link in re.findall(r"\]\(([^)]*)\)", text))
