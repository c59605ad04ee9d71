"""The machine a benchmark runs on: what has to be known to compare its figures with others'."""

import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from boards import model
from boards.health import governors, recognise
from boards.tree import Tree
from hil import __version__
from hil.process import ram_mib

PACKAGES = ("eclipse-zenoh", "numpy", "pyserial", "python-can", "pymavlink", "unicorn")
# What emulates this machine, in the environment or on the kernel's command line: tools/virtual_board sets it.
MARK = "UUV_HIL_EMULATED"
# Processors that run the other one's programs by themselves.
WIDER = {"i386": "x86_64", "i686": "x86_64", "armv7l": "aarch64", "armv8l": "aarch64"}
# The machine of an ELF file, at its byte 18 (System V ABI) -> what uname calls it.
ELF_MACHINES = {0x03: "i686", 0x28: "armv7l", 0x3E: "x86_64", 0xB7: "aarch64", 0xF3: "riscv64"}


def describe(root: str = "/") -> tuple[dict[str, Any], tuple[str, ...]]:
    """What the machine whose files are below `root` is, and the labels its figures need."""
    tree = Tree(root)
    board = recognise(tree)
    kernel = os.uname()
    machine = {
        "name": kernel.nodename,
        "board": board.name if board else "",
        "cpu": _cpu(tree),
        "cores": os.cpu_count() or 0,
        "usable_cores": len(os.sched_getaffinity(0)),
        "ram_mib": round(ram_mib()),
        "architecture": kernel.machine,
        "kernel": f"{kernel.sysname} {kernel.release}",
        "system": _system(tree),
        "governors": governors(tree),
        "load": os.getloadavg()[0],
        "python": platform.python_version(),
        "interpreter": sys.executable,
        "uuv-hil": __version__,
        "packages": _versions(),
    }
    return machine, _labels(tree, kernel.machine)


def _labels(tree: Tree, architecture: str) -> tuple[str, ...]:
    labels = []
    mark, real = _mark(tree), _host_architecture(tree)
    if mark:
        labels.append(f"emulated: {mark}")
    elif real and WIDER.get(real, real) != WIDER.get(architecture, architecture):
        labels.append(f"emulated: {architecture} on {real}")
    if "User Mode Linux" in tree.text("/proc/cpuinfo"):
        labels.append("emulated: User Mode Linux")
    if " hypervisor" in tree.text("/proc/cpuinfo"):
        labels.append("virtual machine")
    if not labels and _is_qemu(tree):
        labels.append("emulated, or a virtual machine: QEMU")
    return tuple(labels)


def _mark(tree: Tree) -> str:
    words = dict(word.partition("=")[::2] for word in tree.text("/proc/cmdline").split())
    return os.environ.get(MARK, "") or words.get(MARK, "")


def _is_qemu(tree: Tree) -> bool:
    """Whether it is a machine that only QEMU makes; Arm processors do not tell whether KVM runs them."""
    return model(tree.root) == "linux,dummy-virt" or tree.text("/sys/class/dmi/id/sys_vendor") == "QEMU"


def _host_architecture(tree: Tree) -> str:
    """That of the kernel, before Linux 6.1 of the first process: below qemu-user uname says another.

    Only root may look into the first process.
    """
    told = tree.text("/proc/sys/kernel/arch")
    if told:
        return told
    try:
        with open(tree.path("/proc/1/exe"), "rb") as file:
            head = file.read(20)
    except OSError:
        return ""
    return ELF_MACHINES.get(int.from_bytes(head[18:20], "little"), "") if head[:4] == b"\x7fELF" else ""


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
    found = {}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found
