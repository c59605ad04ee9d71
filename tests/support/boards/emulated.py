"""The virtual board for tests, built once in the user's cache."""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hil.common.errors import DeviceError
from tools.virtual_board.board import VirtualBoard


def built_board() -> VirtualBoard:
    """Return the board with the project as it is now; skips where Debian's packages cannot be fetched."""
    board = VirtualBoard()
    try:
        board.build()
    except DeviceError as error:
        if str(error).startswith("debootstrap:"):
            pytest.skip(f"needs Debian's packages for arm64: {error}")
        raise
    return board


@contextmanager
def held_board() -> Iterator[VirtualBoard]:
    """Provide the built board, locked: no other test builds or changes it until the end."""
    lock = Path(f"{VirtualBoard().folder}.lock")
    lock.parent.mkdir(parents=True, exist_ok=True)
    with open(lock, "w", encoding="utf-8") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield built_board()
