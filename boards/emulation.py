"""Detect an emulated machine, whose measured figures are not valid for a real board."""

import os

from boards import model
from boards.tree import Tree

# Variable of the environment or of the kernel's command line that names the emulator; tools/virtual_board sets it.
MARK = "UUV_HIL_EMULATED"
# Architecture -> the wider one whose processors also run its programs.
WIDER = {"i386": "x86_64", "i686": "x86_64", "armv7l": "aarch64", "armv8l": "aarch64"}


def labels(tree: Tree, architecture: str) -> tuple[str, ...]:
    """Return labels for a machine's measured figures ("virtual machine"). `architecture` is as uname reports it."""
    texts, processors = [], tree.text("/proc/cpuinfo")
    mark, real = _mark(tree), tree.text("/proc/sys/kernel/arch")  # which qemu-user does not change; since Linux 6.1
    if mark:
        texts.append(f"emulated: {mark}")
    elif real and WIDER.get(real, real) != WIDER.get(architecture, architecture):
        texts.append(f"emulated: {architecture} on {real}")
    if "User Mode Linux" in processors:
        texts.append("emulated: User Mode Linux")
    if " hypervisor" in processors:
        texts.append("virtual machine")
    if not texts and _is_qemu(tree):
        texts.append("emulated, or a virtual machine: QEMU")
    return tuple(texts)


def _mark(tree: Tree) -> str:
    words = dict(word.partition("=")[::2] for word in tree.text("/proc/cmdline").split())
    return os.environ.get(MARK, "") or words.get(MARK, "")


def _is_qemu(tree: Tree) -> bool:
    """Return whether this machine is made by QEMU. On Arm the processor does not show whether KVM is used."""
    return model(tree.root) == "linux,dummy-virt" or tree.text("/sys/class/dmi/id/sys_vendor") == "QEMU"
