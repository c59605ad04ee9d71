"""Files and command outputs of a machine: of this one, or of a recorded one.

A recorded machine is a folder with parts of its /proc, /sys, /dev, /etc. The outputs of commands are in `commands/`, in
files named like the command, with _ for each space. Symbolic links are followed as on the machine: an absolute link
starts at the folder, and .. does not leave it.

psutil reads memory, TCP ports and processes from the /proc of such a folder (boards/resources.py).
"""

import os

LINKS = 40  # limit of followed links for one name, as in Linux: path_resolution(7)
NOWHERE = "/dev/null/too many links"  # /dev/null is no folder, so this path neither exists nor can be made


class Tree:
    """Files and command outputs of the machine below `root`. No method raises; missing data are empty or None."""

    def __init__(self, root: str = "/") -> None:
        self.root = root
        self.live = os.path.realpath(root) == "/"

    def path(self, name: str) -> str:
        """Return the path on this machine of a file of the recorded machine. Links are followed, unlike in `entry`."""
        return os.path.join(self.root, name.lstrip("/")) if self.live else self._inside(name, follow_last=True)

    def entry(self, name: str) -> str:
        """Return the path on this machine of a file of the recorded machine; of the link itself if it is one."""
        return os.path.join(self.root, name.lstrip("/")) if self.live else self._inside(name, follow_last=False)

    def exists(self, name: str) -> bool:
        """Return whether there is such a file or folder."""
        return os.path.exists(self.path(name))

    def text(self, name: str) -> str:
        """Return the text of a file, without leading and trailing white space and zero bytes (of device trees)."""
        try:
            with open(self.path(name), "rb") as file:
                return file.read().decode("utf-8", "replace").strip(" \t\r\n\0")
        except (OSError, ValueError):  # ValueError: a zero byte in the name
            return ""

    def number(self, name: str) -> int | None:
        """Return the decimal number in a file; None if it contains anything else."""
        try:
            return int(self.text(name))
        except ValueError:
            return None

    def names(self, folder: str) -> list[str]:
        """Return the names in a folder, sorted."""
        try:
            return sorted(os.listdir(self.path(folder)))
        except (OSError, ValueError):
            return []

    def link(self, name: str) -> str:
        """Return the target of a symbolic link; empty if it is no link, or not readable."""
        try:
            return os.readlink(self.entry(name))
        except (OSError, ValueError):
            return ""

    def resolve(self, name: str) -> str:
        """Return the device that a link leads to: /dev/serial0 -> /dev/ttyS0."""
        for _ in range(8):
            target = self.link(name)
            if not target:
                break
            name = os.path.normpath(os.path.join(os.path.dirname(name), target))
        return name

    def run(self, *command: str) -> str | None:
        """Return the standard output of a command; None if it is missing, fails, or takes over 5 s."""
        if not self.live:
            recorded = f"commands/{'_'.join(command)}"
            return self.text(recorded) if self.exists(recorded) else None
        import subprocess

        path = os.pathsep.join((os.environ.get("PATH", ""), "/usr/sbin", "/sbin"))  # where iw and ip may be
        there = os.environ | {"PATH": path}
        try:
            done = subprocess.run(command, check=False, capture_output=True, timeout=5, env=there)
        except (OSError, ValueError, subprocess.TimeoutExpired):
            return None
        return done.stdout.decode("utf-8", "replace").strip() if done.returncode == 0 else None

    def _inside(self, name: str, follow_last: bool) -> str:
        """Return the path on this machine of a recorded name. Links are followed within the root, as by chroot(2)."""
        left, resolved, links = name.split("/"), list[str](), 0
        while left:
            name_part, *left = left
            if name_part in ("", ".", ".."):
                resolved = resolved[:-1] if name_part == ".." else resolved
                continue
            target = _link(os.path.join(self.root, *resolved, name_part)) if left or follow_last else ""
            if not target:
                resolved.append(name_part)
                continue
            links += 1
            if links > LINKS:
                return NOWHERE
            resolved = [] if target.startswith("/") else resolved
            left = target.split("/") + left
        return os.path.join(self.root, *resolved)


def _link(path: str) -> str:
    """Return the target of a symbolic link; empty if it is no link."""
    try:
        return os.readlink(path)
    except (OSError, ValueError):
        return ""


def architecture(tree: Tree) -> str:
    """Return the kernel's name of the processor's architecture ("aarch64"); empty if it is unknown.

    It is in /proc/sys/kernel/arch since Linux 6.1, and is derived from /proc/cpuinfo on older kernels.
    """
    if tree.live:
        return os.uname().machine
    reported = tree.text("/proc/sys/kernel/arch")
    if reported:
        return reported
    cpuinfo = tree.text("/proc/cpuinfo")
    for mark, name in (("vendor_id", "x86_64"), ("CPU architecture: 8", "aarch64"), ("CPU architecture: 7", "armv7l")):
        if mark in cpuinfo:
            return name
    return ""
