"""Programs of this machine that build the virtual board."""

import os
import shutil
import subprocess
from collections.abc import Mapping

from hil.common.errors import DeviceError

# program -> the package that has it
TO_BUILD = {
    "debootstrap": "debootstrap",
    "dpkg-deb": "dpkg",
    "qemu-aarch64": "qemu-user",
    "aarch64-linux-gnu-gcc": "gcc-aarch64-linux-gnu libc6-dev-arm64-cross",
}
TO_BOOT = TO_BUILD | {"qemu-system-aarch64": "qemu-system-arm", "cpio": "cpio"}


def missing(programs: Mapping[str, str]) -> str:
    """Return a command that installs missing programs; "" if none is missing."""
    packages = [package for program, package in programs.items() if not shutil.which(program)]
    if packages:
        return f"apt install {' '.join(packages)}"
    return "" if os.geteuid() == 0 else "be root: debootstrap needs it"


def do(*command: str, environment: Mapping[str, str] | None = None) -> None:
    """Run a command to its end. Raises DeviceError, with the last line of its output, when it fails."""
    more = {**os.environ, **(environment or {})}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=more)
    if done.returncode:
        last = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()[-1]
        raise DeviceError(f"{command[0]}: ended with {done.returncode}: {last}")
