"""Machines as files, which tests of boards read instead of /proc and /sys.

tests/support/boards/trees/NAME.toml holds one machine: `files` by path, `links`, `modes`. None is from a board
of the project: `source` names the public records of its lines. Of /proc/meminfo only MemTotal is from there.
"""

import os
from pathlib import Path

from hil.common.tables import parse_toml

TREES = Path(__file__).parent / "trees"
# A process with one thread, started 23.45 s after the machine: proc_pid_stat(5).
STAT = (
    "{pid} ({name}) S 1 {pid} {pid} 0 -1 4194560 512 0 0 0 7 3 0 0 20 0 1 0 2345 8650752 1100 18446744073709551615 "
    "1 1 0 0 0 0 0 4096 16387 0 0 0 17 2 0 0 0 0 0 0 0 0 0 0 0 0 0\n"
)
NAMES = sorted(path.stem for path in TREES.glob("*.toml"))


def build(name: str, root: Path) -> Path:
    """Return the machine called `name` below `root`."""
    table = parse_toml((TREES / f"{name}.toml").read_text())
    for path, text in table["files"].items():
        plant(root, path, text)
    for path, target in table.get("links", {}).items():
        link(root, path, target)
    for path, mode in table.get("modes", {}).items():
        (root / path).chmod(int(mode, 8))
    return root


def plant(root: Path, path: str, text: str) -> None:
    (root / path).parent.mkdir(parents=True, exist_ok=True)
    (root / path).write_text(text)


def link(root: Path, path: str, target: str) -> None:
    (root / path).parent.mkdir(parents=True, exist_ok=True)
    (root / path).unlink(missing_ok=True)
    os.symlink(target, root / path)


def plant_process(root: Path, pid: int, command: str, **opened: str) -> None:
    """Plant a process with its command line, and the targets of its file descriptors (fd9="/dev/ttyS0")."""
    words = command.split()
    plant(root, f"proc/{pid}/stat", STAT.format(pid=pid, name=os.path.basename(words[0])))
    plant(root, f"proc/{pid}/cmdline", "\0".join([*words, ""]))
    for descriptor, target in opened.items():
        link(root, f"proc/{pid}/fd/{descriptor.removeprefix('fd')}", target)


def expected_board(name: str) -> str:
    """Return the preset as which the machine must be recognised."""
    board: str = parse_toml((TREES / f"{name}.toml").read_text())["board"]
    return board
