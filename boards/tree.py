"""Files and command outputs of a machine: of this one, or of a recorded one.

A recorded machine is a folder with parts of its /proc, /sys, /dev, /etc. The output of a command is there in
`commands/`, in a file named like the command with _ for its spaces. Its symbolic links are followed as the machine
itself would: an absolute one starts at the folder, and .. does not leave it.

psutil cannot serve here: `uuv-hil doctor --root` and the tests read recorded machines by the same code. With 7.2.2:

* It can be led to another /proc (PROCFS_PATH), but not to another /sys, /dev or /etc, and there it finds no process.
* `virtual_memory` raises KeyError for a /proc/meminfo of which a part was recorded.
* `open_files` leaves devices out, so that it does not show who has a serial port open.
* `sensors_temperatures` leaves thermal zones out where there is a hwmon; boards are described by their zones.
* It knows nothing of governors, throttling, wlan, CAN, control groups, limits and capabilities.

In the slave it would also cost start-up and memory (hil/slave/health/usage.py).
"""

import os

LINKS = 40  # the most that are followed for one name, as in Linux: path_resolution(7)
NOWHERE = "/dev/null/too many links"  # below what is no folder: nothing is there, and nothing can be made there


class Tree:
    """Files and command outputs of the machine below `root`. Nothing raises: what is missing is empty or None."""

    def __init__(self, root: str = "/") -> None:
        self.root = root
        self.live = os.path.realpath(root) == "/"

    def path(self, name: str) -> str:
        """Return the path here of a file of the machine; links are followed, unlike in `entry`."""
        return os.path.join(self.root, name.lstrip("/")) if self.live else self._inside(name, follow_last=True)

    def entry(self, name: str) -> str:
        """Return the path here of a file of the machine; the link itself if it is one."""
        return os.path.join(self.root, name.lstrip("/")) if self.live else self._inside(name, follow_last=False)

    def exists(self, name: str) -> bool:
        """Return whether there is such a file or folder."""
        return os.path.exists(self.path(name))

    def text(self, name: str) -> str:
        """Return the text of a file without the white space (and the zero bytes of device trees) around it."""
        try:
            with open(self.path(name), "rb") as file:
                return file.read().decode("utf-8", "replace").strip(" \t\r\n\0")
        except (OSError, ValueError):  # ValueError: a zero byte in the name
            return ""

    def number(self, name: str) -> int | None:
        """Return the decimal number in a file; None if it holds anything else."""
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
        """Return where a symbolic link points to; empty if it is none, or not readable."""
        try:
            return os.readlink(self.entry(name))
        except (OSError, ValueError):
            return ""

    def resolve(self, name: str) -> str:
        """Return the path in the machine that a device's name stands for: /dev/serial0 -> /dev/ttyS0."""
        for _ in range(8):
            target = self.link(name)
            if not target:
                break
            name = os.path.normpath(os.path.join(os.path.dirname(name), target))
        return name

    def openers(self, target: str) -> list[tuple[int, str]]:
        """Return number and command of the other processes that have a file ("/dev/ttyS0", "socket:[123]") open.

        Only root may look into the processes of other users.
        """
        processes = []
        for pid in filter(str.isdecimal, self.names("/proc")):
            folder = f"/proc/{pid}/fd"
            if self.live and int(pid) == os.getpid():
                continue
            if any(self.link(f"{folder}/{descriptor}") == target for descriptor in self.names(folder)):
                processes.append((int(pid), self.text(f"/proc/{pid}/cmdline").replace("\0", " ") or "unknown"))
        return processes

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
        """Return the path here of a name in the machine, its links followed within the root as chroot(2) would."""
        left, place, links = name.split("/"), list[str](), 0
        while left:
            part, *left = left
            if part in ("", ".", ".."):
                place = place[:-1] if part == ".." else place
                continue
            target = _link(os.path.join(self.root, *place, part)) if left or follow_last else ""
            if not target:
                place.append(part)
                continue
            links += 1
            if links > LINKS:
                return NOWHERE
            place = [] if target.startswith("/") else place
            left = target.split("/") + left
        return os.path.join(self.root, *place)


def _link(path: str) -> str:
    """Return where a symbolic link points to; empty if it is none."""
    try:
        return os.readlink(path)
    except (OSError, ValueError):
        return ""


def architecture(tree: Tree) -> str:
    """Return the kernel's name of the processor's architecture ("aarch64"); empty if it is unknown.

    /proc/sys/kernel/arch is there since Linux 6.1; before, /proc/cpuinfo shows which it is.
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
