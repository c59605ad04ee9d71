"""Every board file loads, and a board is recognised by its device tree."""

from pathlib import Path

import pytest

import boards
from hil.errors import ConfigError
from hil.schema import preset_names

NAMES = preset_names("boards")


@pytest.mark.parametrize("name", NAMES)
def test_every_board_loads_and_names_its_source(name: str) -> None:
    board = boards.load_board(name)
    assert board.source
    assert board.uart.startswith("/dev/")
    assert board.models


@pytest.mark.parametrize(
    ("model", "name"),
    [
        ("Raspberry Pi 4 Model B Rev 1.5\0", "Raspberry Pi 4 Model B"),
        ("NVIDIA Jetson Nano Developer Kit\0", "NVIDIA Jetson Nano"),
        ("Some Other Board\0", None),
        ("", None),
    ],
)
def test_detection(tmp_path: Path, model: str, name: str | None) -> None:
    tree = tmp_path / "proc" / "device-tree"
    tree.mkdir(parents=True)
    (tree / "model").write_text(model)
    found = boards.detect(str(tmp_path))
    assert (found.name if found else None) == name


def test_a_machine_without_device_tree(tmp_path: Path) -> None:
    assert boards.detect(str(tmp_path)) is None


def test_a_wrong_board_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('name = "x"\nsource = "y"\ncpu = "z"\ncores = 4\nram = "4"\n')
    with pytest.raises(ConfigError, match=r"mine\.toml: ram.*unit"):
        boards.load_board(str(path))
