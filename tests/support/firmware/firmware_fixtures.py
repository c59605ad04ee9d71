"""The core in C, compiled once for all tests of it."""

import shutil
from pathlib import Path

import pytest

from firmware_stub import build
from tests.support.once import made_once

SANITIZED = ["gcc", "-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "--coverage"]
TOOLS = ("gcc", "gcov")


@pytest.fixture(scope="session")
def core(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Compile core_main.c, the core with MAVLink, with sanitizers and with counts of executed lines."""
    if missing := [tool for tool in TOOLS if not shutil.which(tool)]:
        pytest.skip(f"needs {' and '.join(missing)}")
    pytest.importorskip("pymavlink", reason="the core's MAVLink is made with pymavlink")
    sources = [str(Path(__file__).with_name("core_main.c"))]
    folder = made_once(
        tmp_path_factory,
        "core",
        lambda folder: build.compile_core(str(folder / "core"), sources, SANITIZED, mavlink=True),
    )
    return str(folder / "core")
