"""Card computers as data: one TOML a board."""

import os
from typing import Annotated, NamedTuple

from hil.schema import Range, find_preset, load, preset_names

FOLDER = "boards"


class Board(NamedTuple):
    """A card computer.

    `models` are beginnings of the text in /proc/device-tree/model by which it is recognised; `uart` is
    the serial port on its pin header.
    """

    name: str
    source: str
    cpu: str
    cores: Annotated[int, Range(1, 256)]
    ram: Annotated[float, Range(64, 1_048_576, "MiB")]
    models: tuple[str, ...] = ()
    uart: str = ""


def load_board(name: str) -> Board:
    """The board called `name`, or the file at a path ending in `.toml`. Raises ConfigError."""
    return load(find_preset(FOLDER, name), Board)


def detect(root: str = "/") -> Board | None:
    """The board this machine is, by its device tree below `root`; None when it is none of ours."""
    try:
        with open(os.path.join(root, "proc/device-tree/model"), "rb") as file:
            model = file.read().rstrip(b"\0").decode("utf-8", "replace")
    except OSError:
        return None
    for name in preset_names(FOLDER):
        board = load_board(name)
        if any(model.startswith(beginning) for beginning in board.models):
            return board
    return None
