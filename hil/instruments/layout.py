"""Messages that are declared as text: formats of `struct`, each with the quantity that it carries."""

from collections.abc import Callable, Mapping, Sequence
from struct import pack
from typing import Any, TypeVar

Of = TypeVar("Of")


def pack_layout(layout: str, quantities: Mapping[str, Callable[[Of], Sequence[Any]]], of: Of) -> bytes:
    """Return a message, little endian, of parts such as "3f:rate", "B:7" (always 7) and "4x" (padding).

    `quantities` has the values of each name for what the message is `of`.
    """
    data = b""
    for part in layout.split():
        form, _, name = part.partition(":")
        values = quantities[name](of) if name in quantities else [int(name)] if name else ()
        data += pack(f"<{form}", *values)
    return data
