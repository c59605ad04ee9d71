"""taplo, the checker in "Even Better TOML" of VS Code, reads the schemas and finds wrong keys with them."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hil.cli import main
from hil.common.schema import find_preset
from tests.support.documents import blocks

TAPLO = shutil.which("taplo", path=str(Path(sys.executable).parent)) or shutil.which("taplo")
pytestmark = pytest.mark.skipif(TAPLO is None, reason="taplo is in the extra dev")
PRESETS = {
    "scenario": ("hil/scenario/presets", "task_scheduling"), "fleet": ("hil/scenario/presets", "target_hunting"),
    "vehicle": ("sim/vehicles", "remus100"), "world": ("sim/worlds", "harbour"), "board": ("boards", "jetson_nano"),
    "frame": ("firmware_stub/frames", "aa55"),
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Provide a folder with all schemas in `schemas`."""
    folder = tmp_path_factory.mktemp("taplo")
    assert main(["scenario", "schema", "-o", str(folder / "schemas")]) == 0
    return folder


def lint(folder: Path, text: str) -> str:
    """Return taplo's findings about a file; empty if there are none."""
    (folder / "file.toml").write_text(text)
    assert TAPLO
    done = subprocess.run([TAPLO, "lint", "file.toml"], cwd=folder, capture_output=True, text=True, check=False)
    return "" if done.returncode == 0 else done.stderr


@pytest.mark.parametrize("kind", PRESETS)
def test_an_unknown_key_is_found(kind: str, folder: Path) -> None:
    head = f"#:schema ./schemas/{kind}.schema.json\n"
    text = Path(find_preset(*PRESETS[kind])).read_text()
    assert lint(folder, head + text) == ""
    assert "'no_such_key'" in lint(folder, f"{head}no_such_key = 1\n{text}")


def test_the_example_of_the_documentation_is_checked(folder: Path) -> None:
    (toml,) = [block.text for block in blocks("toml") if "#:schema" in block.text]
    assert lint(folder, toml) == ""
    assert "is not valid" in lint(folder, toml.replace('"200 ms"', '"200"'))
