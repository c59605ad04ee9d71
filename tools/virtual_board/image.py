"""Write the board's files as archives that a kernel boots from, one behind the other: cpio, as for an initramfs."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
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
LINKS = {
    "etc/systemd/system/multi-user.target.wants/job.service": "../job.service",
    # Nobody logs in.
    **{
        f"etc/systemd/system/{name}.service": "/dev/null"
        for name in ("serial-getty@ttyAMA0", "getty-static", "systemd-binfmt")
    },
}


def kernel(board: VirtualBoard) -> str:
    """Return the path of the board's kernel."""
    folder = os.path.join(board.root, "boot")
    return os.path.join(folder, next(name for name in sorted(os.listdir(folder)) if name.startswith("vmlinuz")))


def write_image(board: VirtualBoard, job: str, path: str) -> None:
    """Write the archives of root, of the kernel modules that a job may need, and of project and `job`, a script."""
    with tempfile.TemporaryDirectory(dir=board.folder) as name, open(path, "wb") as file:
        _archive(board.root, _kept(board.root), file)
        modules = _staged_modules(board)
        _archive(modules, _below(modules, "usr"), file)
        folder = Path(name)
        shutil.copytree(board.site, folder / INSTALLED, symlinks=True, copy_function=os.link)
        for database in ("passwd", "group"):
            master = Path(board.root, f"usr/share/base-passwd/{database}.master")
            _write(folder, f"etc/{database}", master.read_text(encoding="utf-8"))
        for inside, text in FILES.items():
            _write(folder, inside, text)
        for inside, text in (("init", INIT), ("opt/job", job)):
            _write(folder, inside, text).chmod(0o755)
        for inside, target in LINKS.items():
            place = folder / inside
            place.parent.mkdir(parents=True, exist_ok=True)
            place.symlink_to(target)
        _archive(name, _below(name), file)


def _write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def _archive(folder: str, names: Iterable[str], file: BinaryIO) -> None:
    """Append an archive of these names in a folder; all belong to root."""
    command = ["cpio", "--quiet", "--null", "--create", "--format=newc", "--owner=0:0"]
    subprocess.run(command, cwd=folder, input="\0".join(names).encode(), stdout=file, check=True)


def _below(folder: str, start: str = "") -> Iterator[str]:
    """Yield the names in a folder, from those in `start` on; a folder comes before its content."""
    for place, folders, files in os.walk(os.path.join(folder, start)):
        for name in (*folders, *files):
            yield os.path.relpath(os.path.join(place, name), folder)


def _kept(root: str) -> Iterator[str]:
    return (name for name in _below(root) if not any(f"{name}/".startswith(f"{left}/") for left in LEFT_OUT))


def _staged_modules(board: VirtualBoard) -> str:
    """Return the folder of the modules that a job may need, with the tables of their dependencies; made once."""
    staged = os.path.join(board.folder, "modules")
    if os.path.isdir(staged):
        return staged
    (release,) = os.listdir(os.path.join(board.root, "usr/lib/modules"))
    new = f"{staged}.{os.getpid()}"
    for inside in _below(board.root, f"usr/lib/modules/{release}"):
        source = os.path.join(board.root, inside)
        wanted = os.path.basename(inside).startswith("modules.") or any(part in inside for part in MODULES)
        if wanted and os.path.isfile(source):
            target = os.path.join(new, inside)
            os.makedirs(os.path.dirname(target), exist_ok=True)
            shutil.copyfile(source, target)
    os.symlink("usr/lib", os.path.join(new, "lib"))
    kmod = os.path.join(board.root, "usr/bin/kmod")
    subprocess.run(["qemu-aarch64", "-0", "depmod", "-L", board.root, kmod, "-b", new, release], check=True)
    os.rename(new, staged)
    return staged
