"""Reference page of the STM32 chips and their wiring, from the descriptions of the images."""

from firmware_stub.image import CHIPS, Image, load_image

HEAD = """\
# STM32 boards

The package has a firmware image for each of these chips (`firmware_stub/images`). `uuv-hil stm32 flash` writes an image
to a chip ([A real STM32](../tutorials/real_stm32.md#4-flash-the-board)). No image has run on hardware yet. Each image
runs in two emulators: in Unicorn with a model of its chip, and in QEMU. QEMU has no model of some chips: it runs the
image for the F103 on an F100, and those for the F411 and F446 on an F405.

| property of all images | value |
|---|---|
| outputs | eight pins, 50 Hz by default |
| serial port | 115200 bit/s 8N1 by default; protocols `frame` and `mavlink` |
| CAN, if the chip has it | 500 kbit/s by default; protocol `vesc` |
| no command for 200 ms (default) | all outputs are neutral (1500 µs) |
| the program hangs | the chip's independent watchdog restarts it within about 100 ms |
| while the chip starts | no pulses |

This page is made by `python -m tools.reference` from `firmware_stub/images/*.toml`.
"""


def page() -> str:
    """Return the page of the STM32 chips."""
    images = [load_image(chip) for chip in CHIPS]
    return "\n".join([HEAD, _overview(images), *(_wiring(image) for image in images)])


def _overview(images: list[Image]) -> str:
    rows = ["| `--chip` | chip | boards | device id | clock | CAN | image |", "|---|---|---|---|---|---|---|"]
    for image in images:
        ids = ", ".join(f"{number:#05x}" for number in image.device_ids)
        can = "yes" if image.can else "no: the chip has no controller"
        boards = ", ".join(image.boards)
        rows.append(
            f"| `{image.name}` | {image.chip} | {boards} | {ids} | {image.clock} | {can} | {image.size} bytes |"
        )
    return "\n".join([*rows, ""])


def _wiring(image: Image) -> str:
    nucleo = " Nucleo |" if image.headers else ""
    rows = [f"| signal | pin |{nucleo} note |", f"|---|---|{'---|' if nucleo else ''}---|"]
    serial, can = image.serial, image.can
    signals = [(f"output {i}", pin, "") for i, pin in enumerate(image.outputs, 1)]
    signals += [(f"{serial['port']} TX", serial["tx"], serial["note"]), (f"{serial['port']} RX", serial["rx"], "")]
    if can:
        signals += [("CAN RX", can["rx"], can["note"]), ("CAN TX", can["tx"], "")]
    for signal, pin, note in signals:
        header = f" {image.headers.get(pin, '')} |" if nucleo else ""
        rows.append(f"| {signal} | {pin} |{header} {note} |")
    return "\n".join([f"## {image.chip}", "", *rows, ""])
