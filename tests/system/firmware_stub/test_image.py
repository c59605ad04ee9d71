"""The shipped images: complete, of the present sources, and reproducible bit for bit."""

import re
import shutil
import struct
from pathlib import Path
from typing import Any

import pytest

from firmware_stub import build
from firmware_stub.image import CHIPS, describe_image, image_path, load_image, parameters
from hil.common.errors import DeviceError
from hil.common.tables import parse_toml

FLASH, SECTOR = 0x0800_0000, 16 * 1024
RAM_TOP = {"f103": 0x2000_2000}
REMEDY = "make it again: python -m firmware_stub.build"


@pytest.fixture(params=CHIPS)
def chip(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def recipe(chip: str) -> dict[str, Any]:
    return parse_toml(Path(image_path(chip)).with_suffix(".toml").read_text())


def test_the_image_is_complete(chip: str, recipe: dict[str, Any]) -> None:
    assert build.fingerprint([image_path(chip)]) == recipe["sha256"], REMEDY
    assert Path(image_path(chip)).stat().st_size == recipe["size"] <= SECTOR


def test_the_image_is_of_the_present_sources(chip: str, recipe: dict[str, Any]) -> None:
    assert build.fingerprint(build.image_sources(chip)) == recipe["sources"], REMEDY


def test_interrupt_vectors_point_into_memory(chip: str, recipe: dict[str, Any]) -> None:
    """The stack begins at the top of the RAM, and each interrupt has a handler in Thumb code of this image."""
    header = (Path(build.HERE) / "src" / chip / "chip.h").read_text()
    (interrupts,) = re.findall(r"#define INTERRUPTS (\d+)u", header)
    count = 16 + int(interrupts)
    stack, *handlers = struct.unpack_from(f"<{count}I", Path(image_path(chip)).read_bytes())
    assert stack == RAM_TOP.get(chip, 0x2002_0000)
    assert all(h % 2 == 1 and FLASH < h < FLASH + recipe["size"] for h in handlers)


def test_the_description_of_the_image_matches_its_source_folder(chip: str, recipe: dict[str, Any]) -> None:
    made_by = {key: recipe[key] for key in ("compiler", "pymavlink", "sources", "size", "sha256")}
    assert Path(image_path(chip)).with_suffix(".toml").read_text() == build.description(chip, made_by), REMEDY
    image = load_image(chip)
    assert image.device_ids
    assert image.boards
    assert len(set(image.outputs)) == 8
    assert set(image.headers) <= {*image.outputs, *image.can.values()}


def test_parameters_are_encoded_as_the_board_reads_them() -> None:
    """The parameters are five little-endian words, see src/stm32/stm32.h."""
    assert parameters(8, 0.25).hex(" ", 4) == "55555650 08000000 fa000000 32000000 00c20100"
    for channels in (0, 9):
        with pytest.raises(DeviceError, match=f"drives 1 to 8 thrusters, not {channels}"):
            parameters(channels)


@pytest.mark.arm
@pytest.mark.skipif(not shutil.which(build.ARM), reason=f"needs {build.ARM}")
def test_a_rebuilt_image_is_the_same_bit_for_bit(chip: str, recipe: dict[str, Any], tmp_path: Path) -> None:
    image = build.make_image(str(tmp_path), chip)
    here = build.recipe(image.binary, chip)
    for tool in ("compiler", "pymavlink"):
        if here[tool] != recipe[tool]:
            pytest.skip(f"it was made with {tool} {recipe[tool]}; here is {here[tool]}")
    for ending in (".bin", ".toml"):
        made, shipped = (Path(path).with_suffix(ending) for path in (image.binary, image_path(chip)))
        assert made.read_bytes() == shipped.read_bytes(), REMEDY


@pytest.mark.arm
@pytest.mark.skipif(not shutil.which(build.ARM), reason=f"needs {build.ARM}")
def test_an_image_for_another_crystal_is_built(tmp_path: Path) -> None:
    """Its description has its checksum, and a frequency that the F103's PLL cannot make is refused."""
    image = build.make_image(str(tmp_path), "f411", 25)
    described = describe_image(image.binary)
    assert described.sha256 == build.fingerprint([image.binary]) != load_image("f411").sha256
    assert described.name == "f411"
    with pytest.raises(DeviceError, match="from this crystal the PLL does not make 64 MHz"):
        build.compile_image(str(tmp_path), "f103", 12)
