"""The image for the STM32F405 that is shipped: whole, of the present sources, and the same bits when made again."""

import shutil
import struct
from pathlib import Path
from typing import Any

import pytest

from firmware_stub import build
from firmware_stub.image import IMAGE, parameters
from hil.common.errors import DeviceError
from hil.common.tables import parse_toml

FLASH, SECTOR = 0x0800_0000, 16 * 1024
RAM_TOP = 0x2002_0000
REMEDY = "make it again: python -m firmware_stub.build"


@pytest.fixture
def recipe() -> dict[str, Any]:
    return parse_toml(Path(build.RECIPE).read_text())


def test_it_is_whole(recipe: dict[str, Any]) -> None:
    assert build.fingerprint([IMAGE]) == recipe["sha256"], REMEDY
    assert Path(IMAGE).stat().st_size == recipe["size"] <= SECTOR


def test_it_is_of_the_present_sources(recipe: dict[str, Any]) -> None:
    sources = build.sources("include", "src", "src/f405", "src/f405/freestanding")
    assert build.fingerprint(sources) == recipe["sources"], REMEDY


def test_its_vectors_point_into_memory(recipe: dict[str, Any]) -> None:
    """The stack at the top of the RAM, and 97 handlers in Thumb code of this image; so the core can start."""
    stack, *handlers = struct.unpack("<98I", Path(IMAGE).read_bytes()[: 4 * 98])
    assert stack == RAM_TOP
    reserved_or_code = [h for h in handlers if h]
    assert len(reserved_or_code) == len(handlers)
    assert all(h % 2 == 1 and FLASH < h < FLASH + recipe["size"] for h in handlers)


def test_parameters_as_the_board_reads_them() -> None:
    """Five little-endian words; see src/f405/f405.h."""
    assert parameters(8, 0.25).hex(" ", 4) == "55555650 08000000 fa000000 32000000 00c20100"
    for channels in (0, 9):
        with pytest.raises(DeviceError, match=f"drives 1 to 8 thrusters, not {channels}"):
            parameters(channels)


@pytest.mark.arm
@pytest.mark.skipif(not shutil.which(build.ARM), reason=f"needs {build.ARM}")
def test_made_again_it_is_the_same_to_the_bit(recipe: dict[str, Any], tmp_path: Path) -> None:
    image = build.compile_image(str(tmp_path))
    here = build.recipe(image.binary)
    for tool in ("compiler", "pymavlink"):
        if here[tool] != recipe[tool]:
            pytest.skip(f"it was made with {tool} {recipe[tool]}; here is {here[tool]}")
    assert Path(image.binary).read_bytes() == Path(IMAGE).read_bytes(), REMEDY
