"""`boards/install.sh` on a whole emulated board: from a wheel to a running service, by one command.

It takes some minutes, and is skipped unless selected:

    pytest -m board
"""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hil.common.children import ROOT
from tests.support.boards.emulated import held_board
from tools.virtual_board.board import WHEELS
from tools.virtual_board.commands import TO_BOOT, missing
from tools.virtual_board.system import Booted

pytestmark = [
    pytest.mark.board,
    pytest.mark.timeout(3600),
    pytest.mark.skipif(bool(missing(TO_BOOT)), reason=missing(TO_BOOT)),
]

# The board has no way to a package index: wheels lie in a folder, which is the only other option of pip's.
JOB = r"""
set -e
mount -t tmpfs -o size=600M tmpfs /opt/venvs
echo 'pilot:x:1000:1000::/tmp:/bin/sh' >>/etc/passwd
echo 'pilot:x:1000:' >>/etc/group
unset PYTHONPATH
export PIP_NO_INDEX=1 PIP_FIND_LINKS=/opt/uuv-hil/wheels UUV_HIL_FOLDER=/opt/venvs/uuv-hil
sh /opt/uuv-hil/boards/install.sh /opt/uuv-hil/wheels/uuv_hil-*.whl paper_field --user pilot
until journalctl -u uuv-hil | grep -q ready; do sleep 1; done
echo "service: $(systemctl is-active uuv-hil) $(systemctl is-enabled uuv-hil)"
echo "from: $(tr '\0' ' ' </proc/$(systemctl show -P MainPID uuv-hil)/cmdline)"
/usr/local/bin/uuv-hil board uninstall --yes | tail -1
"""


@pytest.fixture(autouse=True)
def requires_marker(request: pytest.FixtureRequest) -> None:
    """Skip the test unless its marker was selected with -m."""
    if "board" not in str(request.config.option.markexpr):
        pytest.skip("boots a whole emulated board: pytest -m board")


def booted_with_wheels() -> Booted:
    """Return the board, booted, with the project's wheels and those it needs in `site/wheels`."""
    with held_board() as board:
        wheels = Path(board.site) / "wheels"
        pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
        cross = ["env", "CC=aarch64-linux-gnu-gcc", "_PYTHON_HOST_PLATFORM=linux-aarch64", "UUV_HIL_NATIVE=1"]
        subprocess.run([*cross, *pip, "wheel", "--no-deps", "--no-build-isolation", "-w", wheels, ROOT], check=True)
        platforms = [word for name in WHEELS for word in ("--platform", name)]
        needed = ["eclipse-zenoh", "pyserial", "psutil"]
        there = ["--python-version", "3.11", "--abi", "cp311", "--abi", "abi3", "--abi", "none"]
        subprocess.run([*pip, "download", *platforms, *there, "--only-binary=:all:", "-d", wheels, *needed], check=True)
        (Path(board.root) / "opt" / "venvs").mkdir(parents=True, exist_ok=True)
        try:
            return Booted(board, JOB)
        finally:
            shutil.rmtree(wheels)


def test_the_install_script_leaves_a_running_service() -> None:
    with booted_with_wheels() as booted:
        booted.wait(1800.0)
    assert "service: active enabled" in booted.output, booted.output
    assert "from: /opt/venvs/uuv-hil/bin/" in booted.output, booted.output
