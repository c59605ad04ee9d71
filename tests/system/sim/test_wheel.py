"""The wheel: with the C extensions, or pure."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import c_extensions

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("wish", ["", "0"])
def test_the_wheel_has_the_extensions_or_is_pure(wish: str, tmp_path: Path) -> None:
    """One wheel serves all Pythons from 3.10 on this platform with a compiler; else, or on request, it is pure."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=os.environ | {"UUV_HIL_NATIVE": wish})
    assert done.returncode == 0, done.stderr
    (path,) = tmp_path.iterdir()
    names = zipfile.ZipFile(path).namelist()
    inside = c_extensions.BINARY in names
    assert {binary in names for binary in c_extensions.SOURCES} == {inside}
    assert inside == (wish == "" and c_extensions.unavailable_reason() is None)
    assert ("-cp310-abi3-linux_" in path.name) == inside
    assert path.name.endswith("-py3-none-any.whl") != inside
