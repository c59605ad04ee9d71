"""Targets of pyOCD for the chips with images: pyOCD's own flash algorithms, with the memory of these chips.

pyOCD has these chips only as packs that it downloads. Chips of a family are programmed in the same way: our F4 chips
have the sectors and registers of the F412, and an F103C8 those of the F103RC with pages of 1 KiB.
"""

from typing import Any

from pyocd.core.memory_map import FlashRegion, MemoryMap, RamRegion
from pyocd.target import TARGET
from pyocd.target.builtin.target_STM32F103RC import FLASH_ALGO as F1_ALGORITHM
from pyocd.target.builtin.target_STM32F103RC import STM32F103RC
from pyocd.target.builtin.target_STM32F412xx import FLASH_ALGO as F4_ALGORITHM
from pyocd.target.builtin.target_STM32F412xx import STM32F412xE

from firmware_stub.image import load_image

FLASH, RAM, KIB = 0x0800_0000, 0x2000_0000, 1024


def _f4(chip: str) -> MemoryMap:
    sizes = ((64, 16), (64, 64), (load_image(chip).flash_kib - 128, 128))  # KiB of a region, and of its sectors
    regions: list[Any] = []
    start = FLASH
    for size, sector in sizes:
        regions.append(
            FlashRegion(
                start=start, length=size * KIB, sector_size=sector * KIB, page_size=4 * KIB, algo=F4_ALGORITHM,
                is_boot_memory=start == FLASH,
            )
        )  # fmt: skip
        start += size * KIB
    return MemoryMap(*regions, RamRegion(start=RAM, length=128 * KIB))


class _F4(STM32F412xE):  # type: ignore[misc] # pyOCD's constructors have no types
    """An F4. It stops the watchdog while the core is halted, like pyOCD's F412."""

    def __init__(self, session: Any) -> None:
        super(STM32F412xE, self).__init__(session, self.MEMORY_MAP)  # without names for all registers


class F405(_F4):
    """STM32F405 (F407, F415, F417)."""

    MEMORY_MAP = _f4("f405")


class F411(_F4):
    """STM32F411xE."""

    MEMORY_MAP = _f4("f411")


class F446(_F4):
    """STM32F446xE."""

    MEMORY_MAP = _f4("f446")


class F103(STM32F103RC):  # type: ignore[misc]
    """STM32F103x8."""

    MEMORY_MAP = MemoryMap(
        FlashRegion(
            start=FLASH,
            length=load_image("f103").flash_kib * KIB,
            blocksize=KIB,
            is_boot_memory=True,
            algo=F1_ALGORITHM,
        ),
        RamRegion(start=RAM, length=20 * KIB),
    )

    def __init__(self, session: Any) -> None:
        super(STM32F103RC, self).__init__(session, self.MEMORY_MAP)


PREFIX = "uuv_hil_"


def register() -> None:
    """Add these targets to pyOCD's, each as `PREFIX` and the chip's name."""
    TARGET.update({PREFIX + target.__name__.lower(): target for target in (F103, F405, F411, F446)})
