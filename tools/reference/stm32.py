"""Reference page of the STM32 chips and their wiring, from the descriptions of the images."""

from firmware_stub.image import CHIPS, Image, load_image

HEAD = """\
# STM32 boards

The package has a firmware image for each of these chips (`firmware_stub/images`). `uuv-hil stm32 flash` writes it to a
chip, see [A real STM32](../tutorials/real_stm32.md#4-flash-the-board). No image has run on hardware yet. Each runs in
Unicorn with a model of its chip, and in QEMU, where the F103 runs on an F100, and the F411 and F446 on an F405.

All images have eight outputs, 50 Hz by default, and support the frame and MAVLink on the serial port, 115200 bit/s 8N1.
Images for chips with CAN also support the protocol of VESCs on it, 500 kbit/s. After 200 ms without a command all
outputs are neutral (1500 us). The independent watchdog restarts a program that hangs within about 100 ms. While the
chip starts there are no pulses.

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
