"""Describe the properties of a machine on which a benchmark's figures depend."""

import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import psutil

from boards import emulation
from boards.health import governors, recognise
from boards.tree import Tree
from hil.common import __version__

PACKAGES = ("eclipse-zenoh", "numpy", "pyserial", "python-can", "pymavlink", "unicorn")


def describe(root: str = "/") -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return a description of the machine whose files are below `root`, and the labels of its figures."""
    tree = Tree(root)
    board = recognise(tree)
    kernel = os.uname()
    machine = {
        "name": kernel.nodename,
        "board": board.name if board else "",
        "cpu": _cpu(tree),
        "cores": os.cpu_count() or 0,
        "usable_cores": len(os.sched_getaffinity(0)),
        "ram_mib": round(psutil.virtual_memory().total / 2**20),
        "architecture": kernel.machine,
        "kernel": f"{kernel.sysname} {kernel.release}",
        "system": _system(tree),
        "governors": governors(tree),
        "load": psutil.getloadavg()[0],
        "python": platform.python_version(),
        "interpreter": sys.executable,
        "uuv-hil": __version__,
        "packages": _versions(),
    }
    return machine, (*emulation.labels(tree, kernel.machine), *_limits(root))


def _limits(root: str) -> tuple[str, ...]:
    """Return the limits of this process, such as those of taskset, which apply to all that is measured here."""
    online, usable = os.sysconf("SC_NPROCESSORS_ONLN"), len(os.sched_getaffinity(0))
    return (f"limited: {usable} of {online} processors",) if usable < online and root == "/" else ()


def _cpu(tree: Tree) -> str:
    for line in tree.text("/proc/cpuinfo").splitlines():
        name, _, value = line.partition(":")
        if name.strip() in ("model name", "Model"):
            return value.strip()
    return platform.processor()


def _system(tree: Tree) -> str:
    for line in tree.text("/etc/os-release").splitlines():
        if line.startswith("PRETTY_NAME="):
            return line.partition("=")[2].strip('"')
    return ""


def _versions() -> dict[str, str]:
    versions = {}
    for package in PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            continue
    return versions
