"""Flash and RAM of an STM32 (RM0090, section 2.3; RM0008, section 3.3), shared by Python and Unicorn."""

from ctypes import addressof, c_char
from mmap import mmap
from struct import Struct

from firmware_stub.emulation.models import Model

FLASH = 0x0800_0000
READ, WRITE, EXECUTE = 1, 2, 4

_WORD = Struct("<I")


class Memory:
    """Memory by address. `image` is the beginning of the flash; the rest of it is erased."""

    def __init__(self, image: bytes, model: Model) -> None:
        self.image = image
        flash = mmap(-1, model.flash_size)
        flash[:] = image[: model.flash_size].ljust(model.flash_size, b"\xff")
        self._pieces = [(FLASH, flash), *((address, mmap(-1, size)) for address, size in model.ram.items())]

    def find(self, address: int, size: int) -> tuple[mmap, int] | None:
        """Return the memory with the bytes at this address, and their offset in it; None if there is no memory."""
        for start, piece in self._pieces:
            if start <= address and address + size <= start + len(piece):
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
        """Return start, size and the program's access rights of each piece, and its address in this process.

        The flash is also at 0.
        """
        rows = [
            (start, len(piece), READ | EXECUTE if start == FLASH else READ | WRITE | EXECUTE, _host_address(piece))
            for start, piece in self._pieces
        ]
        return [*rows, (0, *rows[0][1:])]


def _host_address(piece: mmap) -> int:
    return addressof(c_char.from_buffer(piece))
