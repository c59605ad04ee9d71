"""The virtual board for tests, built once in the user's cache."""

import pytest

from hil.common.errors import DeviceError
from tools.virtual_board.board import VirtualBoard


def built_board() -> VirtualBoard:
    """The board with the project as it is now; skips where Debian's packages cannot be fetched."""
    board = VirtualBoard()
    try:
        board.build()
    except DeviceError as error:
        if str(error).startswith("debootstrap:"):
            pytest.skip(f"needs Debian's packages for arm64: {error}")
        raise
    return board
