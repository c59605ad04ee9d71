"""Memory, TCP ports and open devices of a machine, read with psutil from the /proc of this machine or a recorded one.

A recorded /proc may lack files that psutil expects. Then the functions return None, or leave the process out.

The slave does not import this module, because psutil would lengthen its start (hil/slave/usage.py).
"""

import os
import struct
from collections.abc import Callable
from typing import Any, TypeVar

import psutil

from boards.tree import Tree

# Errors of psutil for files of /proc that are missing or incomplete.
UNREADABLE = (OSError, ValueError, LookupError, ArithmeticError, RuntimeError, struct.error, psutil.Error)
T = TypeVar("T")


def available_memory_mib(tree: Tree) -> float | None:
    """Return the memory (MiB) that is available to programs; None if it cannot be read."""
    memory = _read(tree, psutil.virtual_memory)
    return memory.available / 2**20 if memory else None


def total_memory_mib(tree: Tree) -> float | None:
    """Return the memory (MiB) of a machine, without what the kernel itself uses; None if it cannot be read."""
    memory = _read(tree, psutil.virtual_memory)
    return memory.total / 2**20 if memory else None


def find_listeners(tree: Tree) -> dict[int, int | None] | None:
    """Return the TCP ports that processes listen on, with the process id: None if only root may read it.

    Return None if the kernel's tables of connections cannot be read.
    """
    connections: list[Any] | None = _read(tree, lambda: psutil.net_connections("tcp"))
    if connections is None:
        return None
    listening = [row for row in connections if row.status == psutil.CONN_LISTEN and row.laddr]
    return {row.laddr.port: row.pid for row in sorted(listening, key=lambda row: row.pid or 0)}


def find_openers(tree: Tree, device: str) -> list[int]:
    """Return the ids of the other processes that have opened a device, such as "/dev/ttyS0".

    Only root may read this of other users' processes. `psutil.Process.open_files` returns regular files only.
    """
    pids = [pid for pid in _read(tree, psutil.pids) or [] if not (tree.live and pid == os.getpid())]
    return [
        pid
        for pid in pids
        if any(tree.link(f"/proc/{pid}/fd/{descriptor}") == device for descriptor in tree.names(f"/proc/{pid}/fd"))
    ]


def describe_process(tree: Tree, pid: int) -> str:
    """Return id and command line of a process: "process 812, /usr/sbin/ModemManager"."""

    def command() -> str:
        process = psutil.Process(pid)
        return " ".join(process.cmdline()) or process.name()

    return f"process {pid}, {_read(tree, command) or 'unknown'}"


def _read(tree: Tree, query: Callable[[], T]) -> T | None:
    """Return the result of a query of psutil to the /proc of a machine; None if psutil cannot read it."""
    previous, psutil.PROCFS_PATH = psutil.PROCFS_PATH, tree.path("/proc")
    try:
        return query()
    except UNREADABLE:
        return None
    finally:
        psutil.PROCFS_PATH = previous
