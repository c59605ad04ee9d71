"""Flash and RAM of an STM32 (RM0090, section 2.3; RM0008, section 3.3), shared by Python and Unicorn."""

from ctypes import addressof, c_char
from mmap import mmap
from struct import Struct
from typing import NamedTuple

from firmware_stub.emulation.models import KIB, Model

FLASH = 0x0800_0000
# System memory of a family, which identifies the chip: its address and size, and the offsets of the unique id and of
# the flash size.
SYSTEM = {"f4": (0x1FFF_0000, 0x8000, 0x7A10, 0x7A22), "f1": (0x1FFF_F000, 0x1000, 0x7E8, 0x7E0)}
READ, WRITE, EXECUTE = 1, 2, 4

_WORD = Struct("<I")


class Region(NamedTuple):
    """A region of memory; `rights`: access rights of the program, a combination of READ, WRITE, EXECUTE."""

    start: int
    size: int
    rights: int


class Memory:
    """Memory by address. `image` is the beginning of the flash; the rest of it is erased.

    `number`: that of the board, 0 to 65535, a part of its unique id.
    """

    def __init__(self, image: bytes, model: Model, number: int = 0) -> None:
        self.image = image
        start, size, unique_id, flash_kib = SYSTEM[model.family]
        self.regions = [
            Region(FLASH, model.flash_size, READ | EXECUTE),
            *(Region(address, ram, READ | WRITE | EXECUTE) for address, ram in model.ram.items()),
            Region(start, size, READ | EXECUTE),
        ]
        self.pieces = [(region.start, region.size, mmap(-1, region.size)) for region in self.regions]
        self.pieces[0][2][:] = image[: model.flash_size].ljust(model.flash_size, b"\xff")
        system = self.pieces[-1][2]
        system[unique_id : unique_id + 12] = f"uuv-hil{model.name[-3:]}".encode() + number.to_bytes(2, "big")
        system[flash_kib : flash_kib + 2] = (model.flash_size // KIB).to_bytes(2, "little")

    def find(self, address: int, size: int) -> tuple[mmap, int] | None:
        """Return the memory with the bytes at this address, and their offset in it; None if there is no memory."""
        for start, length, piece in self.pieces:
            if start <= address and address + size <= start + length:
                return piece, address - start
        return None

    def read_word(self, address: int) -> int:
        """Return the 32-bit word at an address; 0 if there is no memory."""
        place = self.find(address, 4)
        word: int = _WORD.unpack_from(*place)[0] if place else 0
        return word

    def read_code(self, address: int, size: int) -> bytes:
        """Return up to `size` bytes of the program at an address."""
        place = self.find(address, 2)
        return place[0][place[1] : place[1] + size] if place else b""

    def mappings(self) -> list[tuple[int, int, int, int]]:
        """Return start, size and rights of each region, and its address in this process. The flash is also at 0."""
        host_addresses = [addressof(c_char.from_buffer(piece)) for _, _, piece in self.pieces]
        regions = [(*region, address) for region, address in zip(self.regions, host_addresses, strict=True)]
        return [*regions, (0, self.regions[0].size, READ | EXECUTE, host_addresses[0])]
