"""The shipped images, the descriptions of their chips, and the parameters that adapt an image to a vehicle.

Both are written to the board once: the image to 0x08000000, the parameters to 0x08004000. Without parameters an image
drives 6 thrusters at 50 Hz, with a watchdog of 200 ms, at 115200 bit/s.
"""

import os
import struct
from typing import Any, NamedTuple

from hil.common.errors import ConfigError, DeviceError

IMAGES = os.path.join(os.path.dirname(os.path.abspath(__file__)), "images")
CHIPS = ("f103", "f405", "f411", "f446")
DEFAULT_CHIP = "f405"  # the emulators use it unless another is given
FLASH_ADDRESS = 0x0800_0000
PARAMETERS_ADDRESS = 0x0800_4000
PARAMETERS_MAGIC = 0x5056_5555
MAX_CHANNELS = 8


def image_path(chip: str = DEFAULT_CHIP) -> str:
    """Return the path of the shipped image for a chip of `CHIPS`. Raises ConfigError for another."""
    if chip not in CHIPS:
        raise ConfigError(f"no image for the chip {chip!r}; there are: {', '.join(CHIPS)}")
    return os.path.join(IMAGES, f"uuv_hil_stm32{chip}.bin")


class Image(NamedTuple):
    """An image, with the wiring of its chip from the .toml beside it. `name` is that in `CHIPS`.

    outputs: the pin of each thruster. serial: `port`, `tx`, `rx` and a `note`. can: `rx`, `tx` and a `note`; empty for
    a chip without CAN. headers: pin -> its name on a Nucleo board. sha256: hash of the image.
    """

    name: str
    path: str
    chip: str
    device_ids: tuple[int, ...]
    flash_kib: int
    boards: tuple[str, ...]
    clock: str
    outputs: tuple[str, ...]
    serial: dict[str, str]
    can: dict[str, str]
    headers: dict[str, str]
    size: int
    sha256: str


def load_image(chip: str) -> Image:
    """Return the description of the image for a chip of `CHIPS`. Raises ConfigError for another, or a damaged file."""
    return describe_image(image_path(chip))


def describe_image(path: str) -> Image:
    """Return the contents of the .toml beside an image. Raises ConfigError without a valid one."""
    from hil.common.tables import parse_toml  # imported here, as an emulated STM32 does not need it

    description = path.removesuffix(".bin") + ".toml"
    try:
        with open(description, encoding="utf-8") as file:
            table: dict[str, Any] = parse_toml(file.read())
        return Image(
            table["chip"].removeprefix("STM32").lower(), path, table["chip"], tuple(table["device_ids"]),
            table["flash_kib"],
            tuple(table["boards"]), table["clock"], tuple(table["outputs"]), table["serial"], table.get("can", {}),
            table.get("headers", {}), table["size"], table["sha256"],
        )  # fmt: skip
    except (OSError, KeyError, ValueError) as error:
        raise ConfigError(
            f"{path}: no valid description beside it, {description} ({error}): make both with "
            "python -m firmware_stub.build, or install uuv-hil again"
        ) from None


def parameters(channels: int, watchdog: float = 0.2, pwm_hz: int = 50, baud: int = 115_200) -> bytes:
    """Return the bytes to write to `PARAMETERS_ADDRESS`; src/stm32/stm32.h has the layout.

    channels: thrusters, 1 to 8. watchdog: the longest time without a command, 0.01 to 60 s. pwm_hz: 50 to 400. baud:
    from 9600 bit/s to a 16th of the serial port's clock. The firmware replaces a value out of range by its default.
    Raises DeviceError for more thrusters than the board has outputs.
    """
    if not 1 <= channels <= MAX_CHANNELS:
        raise DeviceError(f"the STM32's image drives 1 to {MAX_CHANNELS} thrusters, not {channels}")
    return struct.pack("<5I", PARAMETERS_MAGIC, channels, round(watchdog * 1000), pwm_hz, baud)
