"""The board's files, and its programs run by qemu-user: another processor's instructions on this kernel."""

import glob
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from boards.emulation import MARK
from firmware_stub.native import cache_folder
from hil.common.errors import DeviceError
from tools.virtual_board.commands import TO_BUILD, do, missing

PROJECT = Path(__file__).parent.parent.parent
SUITE = "bookworm"  # from debootstrap's default mirror
# The board's Python on this machine. A script, so that its programs can start further ones by sys.executable.
WRAPPER = """\
#!/bin/sh
export PYTHONHOME='{root}/usr' PYTHONPATH='{site}'
export PYTHONSAFEPATH=1  # import installed packages only, not the present folder
export {mark}=qemu-aarch64
exec qemu-aarch64 -cpu {processor} -L '{root}' -0 "$0" '{root}/{python}' "$@"
"""
PACKAGES = "python3,python3-venv,systemd-sysv,udev,kmod,iproute2,linux-image-arm64"
MERGED = ("bin", "sbin", "lib")  # of /, which are links into /usr
PYTHON = "usr/bin/python3.11"
VENV = "usr/lib/python3.11/ensurepip"  # boards that were made before have none
PROCESSOR = "cortex-a72"  # of a Raspberry Pi 4B; with qemu's default numpy uses its slowest code
PYTHON_THERE = "/usr/bin/python3"
WHEELS = ("manylinux_2_28_aarch64", "manylinux2014_aarch64", "linux_aarch64")


class VirtualBoard:
    """The board in `folder` (by default in the user's cache): its Debian in `root`, the project in `site`."""

    def __init__(self, folder: str = "") -> None:
        self.folder = os.path.abspath(folder or os.path.join(cache_folder(), "virtual-board-arm64"))
        self.root, self.site = os.path.join(self.folder, "root"), os.path.join(self.folder, "site")
        self.python = os.path.join(self.folder, "python")

    def build(self, packages: Sequence[str] = ()) -> None:
        """Make the parts that are missing, and install the present project.

        `packages`: further packages from PyPI, as arm64 wheels. Raises DeviceError.
        """
        missing_tools = missing(TO_BUILD)
        if missing_tools:
            raise DeviceError(f"no virtual board can be built here; {missing_tools}")
        os.makedirs(self.folder, exist_ok=True)
        if not all(os.path.exists(os.path.join(self.root, path)) for path in (PYTHON, VENV)):
            self._make_root()
        with tempfile.TemporaryDirectory(dir=self.folder) as scratch:
            self._install(scratch, packages)

    def command(self, *arguments: str, **environment: str) -> list[str]:
        """Return the command that runs the board's Python with these arguments.

        Raises DeviceError if there is no board.
        """
        self.require()
        return ["env", *(f"{name}={value}" for name, value in environment.items()), self.python, *arguments]

    def require(self) -> None:
        """Raise DeviceError if there is no board in the folder."""
        if not all(map(os.path.exists, (os.path.join(self.root, PYTHON), self.site, self.python))):
            raise DeviceError(f"{self.folder}: no virtual board; python -m tools.virtual_board build")

    def _make_root(self) -> None:
        with tempfile.TemporaryDirectory(dir=self.folder) as scratch:
            fetched, unpacked = os.path.join(scratch, "fetched"), os.path.join(scratch, "root")
            # Its second stage, under emulation, takes longer than all other steps, and is not needed.
            do("debootstrap", "--download-only", "--arch=arm64", "--variant=minbase", f"--include={PACKAGES}", SUITE,
               fetched)  # fmt: skip
            for name in MERGED:
                os.makedirs(os.path.join(unpacked, "usr", name))
                os.symlink(f"usr/{name}", os.path.join(unpacked, name))
            for package in sorted(glob.glob(os.path.join(fetched, "var/cache/apt/archives/*.deb"))):
                _unpack(package, unpacked)
            shutil.rmtree(self.root, ignore_errors=True)
            os.rename(unpacked, self.root)

    def _install(self, scratch: str, packages: Sequence[str]) -> None:
        cross = {"CC": "aarch64-linux-gnu-gcc", "_PYTHON_HOST_PLATFORM": "linux-aarch64", "UUV_HIL_NATIVE": "1"}
        pip = (sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check")
        do(*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", scratch, str(PROJECT), environment=cross)
        (wheel,) = glob.glob(os.path.join(scratch, "*.whl"))
        site = os.path.join(scratch, "site")
        platforms = [word for name in WHEELS for word in ("--platform", name)]
        do(*pip, "install", "--target", site, *platforms, "--python-version", "3.11", "--implementation", "cp", "--abi",
           "cp311", "--abi", "abi3", "--abi", "none", "--only-binary=:all:", wheel, *packages)  # fmt: skip
        replace_interpreters(os.path.join(site, "bin"))
        shutil.rmtree(self.site, ignore_errors=True)
        os.rename(site, self.site)
        write_wrapper(self)
        do(*self.command("-m", "compileall", "-q", self.site))


def write_wrapper(board: VirtualBoard) -> None:
    """Write the script that runs the board's Python on this machine."""
    names = {"root": board.root, "site": board.site, "mark": MARK, "processor": PROCESSOR, "python": PYTHON}
    with open(board.python, "w", encoding="utf-8") as file:
        file.write(WRAPPER.format(**names))
    os.chmod(board.python, 0o755)


def replace_interpreters(folder: str) -> None:
    """Replace this machine's Python by the board's in the first line of scripts that pip wrote."""
    for path in glob.glob(os.path.join(folder, "*")):
        with open(path, "rb") as file:
            first, _, remainder = file.read().partition(b"\n")
        # The second form is that of long paths: a line for the shell, which is text to Python.
        if first.startswith(b"#!") and (b"python" in first or remainder.startswith(b"'''exec'")):
            with open(path, "wb") as file:
                file.write(f"#!{PYTHON_THERE}\n".encode() + remainder)


def _unpack(package: str, folder: str) -> None:
    """Unpack a package's files. dpkg-deb -x would put folders in the place of the links /bin, /lib, /sbin."""
    with subprocess.Popen(["dpkg-deb", "--fsys-tarfile", package], stdout=subprocess.PIPE) as archive:
        completed = subprocess.run(
            ["tar", "-x", "--keep-directory-symlink", "-C", folder],
            stdin=archive.stdout, capture_output=True, text=True, check=False,
        )  # fmt: skip
    if completed.returncode or archive.returncode:
        raise DeviceError(f"{package}: cannot be unpacked: {completed.stderr.strip() or 'damaged'}")
