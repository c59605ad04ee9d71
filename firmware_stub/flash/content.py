"""The content of a board's flash, the choice of the image for a chip, and the wiring of its pins."""

import hashlib
from typing import NamedTuple

from firmware_stub.image import CHIPS, FLASH_ADDRESS, PARAMETERS_ADDRESS, Image, load_image
from hil.common.columns import aligned
from hil.common.errors import ConfigError, DeviceError

# DEV_ID of DBGMCU_IDCODE -> STM32 for which there is no image. Source: ST's reference manuals, and the tables of
# github.com/stlink-org/stlink, config/chips.
OTHERS = {
    0x411: "STM32F2", 0x412: "STM32F103 of low density (F103x4, x6)", 0x414: "STM32F103 of high density (F103xC to xE)",
    0x415: "STM32L475, L476 or L486", 0x418: "STM32F105 or F107", 0x419: "STM32F42x or F43x", 0x420: "STM32F100",
    0x422: "STM32F302 or F303", 0x423: "STM32F401 (xB, xC)", 0x430: "STM32F103 of XL density",
    0x433: "STM32F401 (xD, xE)",
    0x434: "STM32F469 or F479", 0x435: "STM32L43x", 0x438: "STM32F303 (x6, x8) or F334", 0x440: "STM32F030x8 or F05x",
    0x441: "STM32F412", 0x444: "STM32F03x", 0x449: "STM32F74x or F75x", 0x450: "STM32H74x or H75x",
    0x458: "STM32F410", 0x463: "STM32F413 or F423", 0x468: "STM32G431 or G441",
}  # fmt: skip


class Content(NamedTuple):
    """The content to write: pairs of address and bytes; the first is the image."""

    image: Image
    pieces: tuple[tuple[int, bytes], ...]


def load_content(image: Image, parameters: bytes | None) -> Content:
    """Return an image's bytes and, if given, a vehicle's parameters. Raises DeviceError for a damaged file."""
    try:
        with open(image.path, "rb") as file:
            data = file.read()
    except OSError as error:
        raise DeviceError(f"{image.path}: {error.strerror}; install uuv-hil again") from None
    if hashlib.sha256(data).hexdigest() != image.sha256:
        raise DeviceError(f"{image.path}: damaged: it is not what the .toml beside it describes; install uuv-hil again")
    pieces = [(FLASH_ADDRESS, data)]
    if parameters is not None:
        pieces.append((PARAMETERS_ADDRESS, parameters))
    return Content(image, tuple(pieces))


def choose_image(device_id: int, chip: str | None) -> Image:
    """Return the image for the chip with that device id. `chip` is the requested chip; None for any.

    Raises ConfigError if there is no image for the chip, or if it is not the requested one.
    """
    images = [load_image(name) for name in CHIPS]
    own = next((image for image in images if device_id in image.device_ids), None)
    name = own.chip if own else OTHERS.get(device_id, "unknown chip")
    description = f"the board has an {name} (device id {device_id:#05x})"
    if own is None:
        names = ", ".join(image.chip for image in images)
        raise ConfigError(f"{description}, and there is no image for it; there are images for {names}")
    if chip is not None and chip != own.name:
        raise ConfigError(f"{description}, and the image is for an {load_image(chip).chip}: --chip {own.name}")
    return own


def wiring(image: Image) -> str:
    """Return the wiring of a board as lines of text: outputs, serial port, CAN."""

    def pin(name: str) -> str:
        header = image.headers.get(name)
        return f"{name} ({header} of a Nucleo)" if header else name

    rows = [(f"  output {i + 1}", pin(name), "signal of its speed controller") for i, name in enumerate(image.outputs)]
    serial, can = image.serial, image.can
    rows += [
        (f"  {serial['port']} TX", pin(serial["tx"]), "to the host's RX; " + serial["note"]),
        (f"  {serial['port']} RX", pin(serial["rx"]), "to the host's TX"),
    ]
    if can:
        rows += [
            ("  CAN RX", pin(can["rx"]), "500 kbit/s; " + can["note"]),
            ("  CAN TX", pin(can["tx"]), ""),
        ]
    head = [f"{image.chip}: {', '.join(image.boards)}", f"  clock: {image.clock}"]
    lines = [*head, *aligned(rows), "  GND is common to board, host and speed controllers"]
    return "\n".join(lines + ([] if can else ["  no CAN: the chip has no controller for it"]))
