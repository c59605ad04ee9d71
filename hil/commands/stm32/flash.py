"""`uuv-hil stm32 flash`: write the firmware's image to a board."""

import argparse
import os
from collections.abc import Callable

from firmware_stub.flash import dfu, probe
from firmware_stub.flash.content import choose_image, load_content, wiring
from firmware_stub.image import CHIPS, MAX_CHANNELS, Image, describe_image, load_image, parameters
from hil.common.errors import ConfigError
from hil.common.options import BAUD, Quantity, integer
from hil.common.streams import LOOK_FIRST, agreed

UNTRIED = "Note: this has been tried with emulated chips and probes only, not on hardware yet."


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of flashing."""
    add = parser.add_argument
    add("--chip", choices=CHIPS, help="chip of the board [recognised]; another one than the board's is refused")
    about = "another image, of python -m firmware_stub.build --output [the shipped one of the chip]"
    add("--image", metavar="FILE.bin", help=about)
    add("--by", choices=("probe", "dfu"), default="probe", help="debug probe or USB bootloader [%(default)s]")
    add("--probe", metavar="TEXT", help="a part of the probe's number; with dfu a path of USB [the only one]")
    add(
        "--under-reset",
        action="store_true",
        help="hold the chip in reset while connecting, for a program that sleeps or uses the debug pins",
    )
    add(
        "--channels",
        metavar="N",
        type=integer(1, MAX_CHANNELS),
        help="also write parameters: number of thrusters [6]",
    )
    watchdog = Quantity(0.01, 60.0, "s")
    add("--watchdog", metavar="S", type=watchdog, help="also write parameters: timeout of the watchdog [200 ms]")
    add("--pwm-hz", metavar="HZ", type=integer(50, 400), help="also write parameters: pulses a second, Hz [50]")
    add("--baud", metavar="BIT/S", type=BAUD, help="also write parameters: speed of the serial port, bit/s [115200]")
    add("--dry-run", action="store_true", help="only show what would be written, and the wiring; write nothing")
    add("--yes", action="store_true", help="do not ask before the board's program is replaced")


def run(options: argparse.Namespace) -> int:
    """Recognise the board, show the wiring, write; return the exit code. Raises HilError."""
    if options.image and not os.path.isfile(options.image):
        fault = "a folder" if os.path.isdir(options.image) else "no such file"
        raise ConfigError(
            f"--image {options.image}: {fault}; name a FILE.bin of python -m firmware_stub.build --output"
        )
    own = describe_image(options.image) if options.image else None
    chip = _named_chip(options.chip, own)
    write = None
    if options.dry_run and chip:  # which needs no board
        image = load_image(chip)
    else:
        image, write = _recognise(options, chip)
    image = own or image
    content = load_content(image, _parameters(options))
    print(wiring(image))
    for address, data in content.pieces:
        print(f"{'would write' if options.dry_run else 'to write'}: {len(data)} bytes at {address:#010x}")
    print(f"image: {image.path}, sha256 {image.sha256[:16]}")
    print(UNTRIED)
    if options.dry_run or write is None:
        return 0
    if not options.yes and not agreed("replace the board's program?", LOOK_FIRST):
        return 1
    write(content, _report)
    print("done; connect the wires, then: uuv-hil stm32 check --port PORT")
    return 0


def _named_chip(chip: str | None, image: Image | None) -> str | None:
    """Return the chip of --chip or of the image; None without both. Raises ConfigError if they differ."""
    if image is None:
        return chip
    if image.name not in CHIPS:
        raise ConfigError(f"{image.path}: is for an {image.chip}; boards with {', '.join(CHIPS)} are written")
    if chip not in (None, image.name):
        raise ConfigError(f"--chip {chip}: but {image.path} is for an {image.chip}")
    return image.name


def _recognise(options: argparse.Namespace, chip: str | None) -> tuple[Image, Callable[..., None]]:
    """Return the image for the connected board, and the function that writes to it."""
    if options.by == "dfu":
        board = dfu.find_board(options.probe)
        image = dfu.choose_image(board, chip)
        _report(f"board in DFU mode at {board.path}, {board.flash_kib} KiB of flash")
        return image, lambda content, report: dfu.write(board, content, report)
    chosen = probe.find_probe(options.probe)._replace(under_reset=options.under_reset)
    found = probe.identify(chosen)
    image = choose_image(found.device_id, chip)
    name = f"{found.name}, " if found.name else ""
    _report(f"{chosen.name} {chosen.unique_id}: {name}{image.chip}, device id {found.device_id:#05x}")
    return image, lambda content, report: probe.write(chosen, content, report)


def _parameters(options: argparse.Namespace) -> bytes | None:
    """Return the parameters to write; None if none was given, so that those on the board stay."""
    given = {name: getattr(options, name) for name in ("channels", "watchdog", "pwm_hz", "baud")}
    given = {name: value for name, value in given.items() if value is not None}
    return parameters(**({"channels": 6} | given)) if given else None


def _report(text: str) -> None:
    print(text, flush=True)
