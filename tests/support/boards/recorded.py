"""Machines as files: what the readers of boards are given in place of /proc and /sys.

tests/support/boards/trees/NAME.toml holds one machine: `files` by path, `links`, `modes`. None was copied from a board
that the project has: each says in `source` which public records its lines were taken from.
"""

import os
from pathlib import Path

from hil.common.tables import parse_toml

TREES = Path(__file__).parent / "trees"
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
    os.symlink(target, root / path)


def expected_board(name: str) -> str:
    """Return the preset that the machine is to be recognised as."""
    board: str = parse_toml((TREES / f"{name}.toml").read_text())["board"]
    return board
