"""Flash and RAM of the STM32F405 (RM0090, section 2.3), shared by Python and Unicorn."""

from ctypes import addressof, c_char
from mmap import mmap
from struct import Struct
from typing import NamedTuple

FLASH, FLASH_SIZE = 0x0800_0000, 0x10_0000
SYSTEM_MEMORY, UNIQUE_ID, FLASH_KIBIBYTES = 0x1FFF_0000, 0x7A10, 0x7A22
READ, WRITE, EXECUTE = 1, 2, 4

_WORD = Struct("<I")


class Region(NamedTuple):
    """A piece of memory; `rights` of the program, of the bits above."""

    start: int
    size: int
    rights: int


REGIONS = (
    Region(FLASH, FLASH_SIZE, READ | EXECUTE),
    Region(0x2000_0000, 0x2_0000, READ | WRITE | EXECUTE),
    Region(0x1000_0000, 0x1_0000, READ | WRITE),  # the core's own
    Region(SYSTEM_MEMORY, 0x8000, READ | EXECUTE),
)


class Memory:
    """Memory by address. `image` is the beginning of the flash; the rest of it is erased."""

    def __init__(self, image: bytes) -> None:
        self.image = image
        self.pieces = [(region.start, region.size, mmap(-1, region.size)) for region in REGIONS]
        self.pieces[0][2][:] = image[:FLASH_SIZE].ljust(FLASH_SIZE, b"\xff")
        system = self.pieces[-1][2]
        system[UNIQUE_ID : UNIQUE_ID + 12] = b"uuv-hil\0f405"
        system[FLASH_KIBIBYTES : FLASH_KIBIBYTES + 2] = (FLASH_SIZE // 1024).to_bytes(2, "little")

    def find(self, address: int, size: int) -> tuple[mmap, int] | None:
        """Return the region that holds these bytes, and their offset in it; None if there is none."""
        for start, length, piece in self.pieces:
            if start <= address and address + size <= start + length:
                return piece, address - start
        return None

    def word(self, address: int) -> int:
        """Return the 32 bits there, 0 where no memory is."""
        place = self.find(address, 4)
        word: int = _WORD.unpack_from(*place)[0] if place else 0
        return word

    def code(self, address: int, size: int) -> bytes:
        """Return up to that many bytes of a program."""
        place = self.find(address, 2)
        return place[0][place[1] : place[1] + size] if place else b""

    def places(self) -> list[tuple[int, int, int, int]]:
        """Return start, size and rights of each region, and its address in this process; the flash is also at 0."""
        here = [addressof(c_char.from_buffer(piece)) for _, _, piece in self.pieces]
        regions = [(*region, place) for region, place in zip(REGIONS, here, strict=True)]
        return [*regions, (0, FLASH_SIZE, READ | EXECUTE, here[0])]
