"""GNU Octave with the package +uuv, run as by a user."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from hil.gateways.json_lines.server import JsonGateway
from tests.support.processes import ROOT

MATLAB = ROOT / "hil" / "gateways" / "matlab"
needs_octave = pytest.mark.skipif(not shutil.which("octave-cli"), reason="GNU Octave is missing: apt install octave")


def write_script(path: Path, script: str) -> None:
    """Write a script that has the package and the template on Octave's path."""
    folders = f"addpath('{MATLAB}'); addpath('{MATLAB / 'template'}');\n"
    path.write_text(f"1;\n{folders}{script}")


def run_octave(folder: Path, script: str, seconds: float = 120.0) -> str:
    """Run a script by Octave in a folder, with the package and the template on its path; return its output."""
    write_script(folder / "script.m", script)
    process = subprocess.run(
        ["octave-cli", "--norc", "--quiet", "script.m"],
        capture_output=True, text=True, timeout=seconds, cwd=folder, env=dict(os.environ),
    )  # fmt: skip
    assert process.returncode == 0, process.stdout + process.stderr
    return process.stdout


def run(folder: Path, gateway: JsonGateway, script: str, seconds: float = 120.0) -> list[str]:
    """Run a script that has a `vehicle` and its `gateway`; return the lines of its output."""
    opened = f"gateway = uuv.Gateway('127.0.0.1', {gateway.port});\nvehicle = uuv.Vehicle('uuv1', gateway);\n"
    return run_octave(folder, opened + script, seconds).split("\n")[:-1]
