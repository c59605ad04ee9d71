"""Write the board's files as one archive that a kernel boots from: cpio in the format "newc", as for an initramfs."""

import os
import shutil
import stat
import subprocess
from collections.abc import Iterator
from typing import BinaryIO

from tools.virtual_board.board import VirtualBoard

# Kernel modules that a job may need; the other 280 MB are left out.
MODULES = ("net/can/", "drivers/net/can/", "virtio", "failover", "sch_netem", "autofs", "vxcan")
LEFT_OUT = (
    "boot",
    "usr/share/doc",
    "usr/share/locale",
    "usr/share/man",
    "usr/share/i18n",
    "var/cache",
    "usr/lib/modules",
)
INSTALLED = "opt/uuv-hil"  # of the site
INIT = """#!/bin/sh
export PATH=/usr/sbin:/usr/bin
mount -t devtmpfs dev /dev
mkdir -p /dev/pts /dev/shm
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t tmpfs tmpfs /dev/shm
for module in virtio_pci virtio_net can_raw kvaser_pci vcan; do modprobe $module; done
ip link set lo up
ip link set eth0 up
ip address add 10.0.2.15/24 dev eth0
ip route add default via 10.0.2.2
exec /lib/systemd/systemd
"""
UNIT = """[Unit]
Description=what is asked of this board
After=multi-user.target
[Service]
Type=oneshot
ExecStart=/opt/job
StandardOutput=tty
StandardError=tty
TTYPath=/dev/ttyAMA0
Environment=TERM=dumb SYSTEMD_COLORS=0 PATH=/opt/uuv-hil/bin:/usr/sbin:/usr/bin PYTHONPATH=/opt/uuv-hil HOME=/root
[Install]
WantedBy=multi-user.target
"""
# Files that the packages would write when configured; they are only unpacked.
FILES = {
    "etc/shadow": "root::0:0:99999:7:::\n",
    "etc/nsswitch.conf": "passwd: files\ngroup: files\nhosts: files\n",
    "etc/hostname": "virtual-board\n",
    "etc/hosts": "127.0.0.1 localhost virtual-board\n",
    "etc/machine-id": "",
    "etc/systemd/system/job.service": UNIT,
    **{
        f"etc/pam.d/common-{kind}": f"{kind} required pam_unix.so\n"
        for kind in ("auth", "account", "password", "session")
    },
}
# Nobody logs in.
MASKED = ("serial-getty@ttyAMA0.service", "getty-static.service", "systemd-binfmt.service")


def kernel(board: VirtualBoard) -> str:
    """Return the path of the board's kernel."""
    folder = os.path.join(board.root, "boot")
    return os.path.join(folder, next(name for name in sorted(os.listdir(folder)) if name.startswith("vmlinuz")))


def write_image(board: VirtualBoard, path: str) -> None:
    """Write the archive of root, project, and the kernel modules that a job may need."""
    with open(path, "wb") as file:
        for number, (name, place) in enumerate(_entries(board), 1):
            _write(file, number, name, place)
        for name in ("usr/share/base-passwd/passwd.master", "usr/share/base-passwd/group.master"):
            with open(os.path.join(board.root, name), "rb") as source:
                _add(file, f"etc/{os.path.basename(name).partition('.')[0]}", source.read())
        for name, text in FILES.items():
            _add(file, name, text.encode())
        _add(file, "init", INIT.encode(), 0o755)
        for name in MASKED:
            _add(file, f"etc/systemd/system/{name}", b"/dev/null", link=True)
        _add(file, "etc/systemd/system/multi-user.target.wants/job.service", b"../job.service", link=True)
        _end(file)


def write_job(script: str, path: str) -> None:
    """Write the small archive with the board's job, which is appended to the large one."""
    with open(path, "wb") as file:
        _add(file, "opt/job", script.encode(), 0o755)
        _end(file)


def _entries(board: VirtualBoard) -> Iterator[tuple[str, str]]:
    """Yield names in the archive and their paths here; a folder comes before its content."""
    for name, place in _below(board.root, ""):
        if not any(name == left or name.startswith(f"{left}/") for left in LEFT_OUT):
            yield name, place
    yield from ((f"usr/lib/{name}", place) for name, place in _modules(board))
    yield from _below(board.site, INSTALLED)


def _modules(board: VirtualBoard) -> Iterator[tuple[str, str]]:
    """Return the modules that a job may need, with the tables of their dependencies."""
    staged = os.path.join(board.folder, "modules")
    if not os.path.isdir(staged):
        _stage(board, staged)
    yield from _below(os.path.join(staged, "usr/lib/modules"), "modules")


def _stage(board: VirtualBoard, staged: str) -> None:
    (release,) = os.listdir(os.path.join(board.root, "usr/lib/modules"))
    place = f"usr/lib/modules/{release}"
    new = f"{staged}.{os.getpid()}"
    for folder, _, files in os.walk(os.path.join(board.root, place)):
        for name in files:
            path = os.path.join(folder, name)
            inside = os.path.relpath(path, board.root)
            if name.startswith("modules.") or any(part in inside for part in MODULES):
                target = os.path.join(new, inside)
                os.makedirs(os.path.dirname(target), exist_ok=True)
                shutil.copyfile(path, target)
    os.symlink("usr/lib", os.path.join(new, "lib"))
    kmod = os.path.join(board.root, "usr/bin/kmod")
    subprocess.run(["qemu-aarch64", "-0", "depmod", "-L", board.root, kmod, "-b", new, release], check=True)
    os.rename(new, staged)


def _below(folder: str, prefix: str) -> Iterator[tuple[str, str]]:
    """Yield the content of a folder, as names below `prefix`, after the folders of `prefix`."""
    parts = prefix.split("/") if prefix else []
    for count in range(1, len(parts) + 1):
        yield "/".join(parts[:count]), folder
    for place, folders, files in os.walk(folder):
        for name in (*sorted(folders), *sorted(files)):
            path = os.path.join(place, name)
            yield os.path.join(prefix, os.path.relpath(path, folder)), path


def _write(file: BinaryIO, number: int, name: str, path: str) -> None:
    status = os.lstat(path)
    data = b""
    if stat.S_ISLNK(status.st_mode):
        data = os.readlink(path).encode()
    elif stat.S_ISREG(status.st_mode):
        with open(path, "rb") as source:
            data = source.read()
    elif not stat.S_ISDIR(status.st_mode):
        return
    _record(file, number, status.st_mode, name, data, int(status.st_mtime))


def _add(file: BinaryIO, name: str, data: bytes, mode: int = 0o644, link: bool = False) -> None:
    """Add an entry that is not a file on this machine, and the folders above it."""
    parts = name.split("/")
    for count in range(1, len(parts)):
        _record(file, 0, stat.S_IFDIR | 0o755, "/".join(parts[:count]), b"")
    _record(file, 0, (stat.S_IFLNK | 0o777) if link else (stat.S_IFREG | mode), name, data)


def _end(file: BinaryIO) -> None:
    _record(file, 0, 0, "TRAILER!!!", b"")


def _record(file: BinaryIO, number: int, mode: int, name: str, data: bytes, time_s: int = 0) -> None:
    """Write one entry: a header of hexadecimal numbers, name and data, each padded to four bytes."""
    label = name.encode() + b"\0"
    fields = (number, mode, 0, 0, 1, time_s, len(data), 0, 0, 0, 0, len(label), 0)
    head = b"070701" + b"".join(b"%08X" % field for field in fields) + label
    for part in (head, data):
        file.write(part + b"\0" * (-len(part) % 4))
