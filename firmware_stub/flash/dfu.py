"""Write by USB: DFU to the bootloader in the chip's ROM, with the program dfu-util.

The bootloader runs if BOOT0 is high at a reset. It describes the flash and not the chip, so it does not distinguish an
F411 from an F446, and the person must choose. An F103 has no USB bootloader.
"""

import os
import re
import shutil
import subprocess
from collections.abc import Callable
from typing import NamedTuple

from firmware_stub.flash.content import Content
from firmware_stub.image import Image, load_image
from hil.common.children import foreign_command
from hil.common.errors import ConfigError, DeviceError
from hil.common.scratch import ScratchFolder

PROGRAM = "dfu-util"
ROM = "0483:df11"  # USB vendor and product id of ST's bootloader
NO_BOARD = (
    f"no board in DFU mode ({ROM}): set BOOT0 high (on a Black Pill hold BOOT0, press and release NRST), connect its "
    "USB socket, look again with: dfu-util -l"
)
WITH_DFU = ("f405", "f411", "f446")
LISTED = re.compile(r'Found DFU: \[0483:df11\].*path="(?P<path>[^"]*)".*name="@Internal Flash\s*(?P<layout>[^"]*)"')
SERIAL = re.compile(r'serial="([^"]*)"')
SECTORS = re.compile(r"(\d+)\*(\d+)([ KM])")
UNITS = {" ": 1, "K": 1024, "M": 1024 * 1024}
TIMEOUT_S = 120.0


class DfuBoard(NamedTuple):
    """A board in DFU mode: its path on USB, its serial number, the size of its flash in KiB."""

    path: str
    serial: str
    flash_kib: int


def find_board(path: str | None) -> DfuBoard:
    """Return the only board in DFU mode, or the one with that USB path or serial number.

    Raises DeviceError without dfu-util, if there is no such board, or if several match.
    """
    if not shutil.which(PROGRAM):
        raise DeviceError(f"no {PROGRAM}: sudo apt install {PROGRAM}; or use a debug probe: --by probe")
    done = _run(["-l"])
    boards = parse_list(done.stdout)
    if not boards:
        errors = [line for line in done.stderr.splitlines() if "Cannot open" in line]
        raise DeviceError(f"{errors[0]}: this user may not open it (udev)" if errors else NO_BOARD)
    chosen = [board for board in boards if path in (None, board.path, board.serial)]
    listed = "; ".join(f"{board.path} (serial {board.serial}, {board.flash_kib} KiB)" for board in boards)
    if not chosen:
        raise DeviceError(f"no board in DFU mode at {path!r}; there are: {listed}")
    if len(chosen) > 1:
        raise DeviceError(f"{len(chosen)} boards in DFU mode: choose one with --probe PATH, of: {listed}")
    return chosen[0]


def parse_list(text: str) -> list[DfuBoard]:
    """Return the boards with ST's bootloader in the output of `dfu-util -l`: one line for each memory of each board."""
    boards = []
    for line in text.splitlines():
        entry = LISTED.search(line)
        if entry:
            size = sum(int(count) * int(each) * UNITS[unit] for count, each, unit in SECTORS.findall(entry["layout"]))
            serial = SERIAL.search(line)
            boards.append(DfuBoard(entry["path"], serial[1] if serial else "", size // 1024))
    return boards


def choose_image(board: DfuBoard, chip: str | None) -> Image:
    """Return the image for a board. `chip` is the requested chip, or None. Raises ConfigError if it does not fit."""
    if chip == "f103":
        raise ConfigError("an STM32F103 has no USB bootloader in its ROM: use a debug probe: --by probe")
    images = {name: load_image(name) for name in WITH_DFU}
    fitting = [name for name, image in images.items() if image.flash_kib == board.flash_kib]
    prefix = f"the board in DFU mode at {board.path} has {board.flash_kib} KiB of flash"
    if chip is not None and chip not in fitting:
        raise ConfigError(f"{prefix}, and an {images[chip].chip} has {images[chip].flash_kib}: not the image for it")
    if chip is None and len(fitting) != 1:
        names = " or ".join(f"--chip {name}" for name in fitting)
        raise ConfigError(
            f"{prefix}: " + (f"say which chip it is, as DFU does not: {names}" if names else "there is no image for it")
        )
    return images[chip or fitting[0]]


def write(board: DfuBoard, content: Content, report: Callable[[str], None]) -> None:
    """Write the content, the image last, and leave the bootloader. Raises DeviceError if dfu-util fails."""
    with ScratchFolder("dfu") as folder:
        for i, (address, data) in enumerate(reversed(content.pieces)):
            path = os.path.join(folder.path, f"{address:08x}.bin")
            with open(path, "wb") as file:
                file.write(data)
            is_last = i == len(content.pieces) - 1
            where = f"{address:#010x}" + (":leave" if is_last else "")
            run = _run(["-d", ROM, "-p", board.path, "-a", "0", "-s", where, "-D", path])
            # When the board leaves the bootloader, its last status may be lost; dfu-util reports that as an error.
            if "File downloaded successfully" not in run.stdout:
                words = [line for line in (run.stderr + run.stdout).splitlines() if line.strip()]
                raise DeviceError(f"{PROGRAM}: {words[-1] if words else f'ended with {run.returncode}'}")
            report(f"{len(data)} bytes at {address:#010x} written")
    report("the board starts the program; set BOOT0 low before the next reset")


def _run(arguments: list[str]) -> "subprocess.CompletedProcess[str]":
    try:
        return subprocess.run(
            foreign_command(PROGRAM, *arguments), capture_output=True, text=True, check=False, timeout=TIMEOUT_S
        )
    except subprocess.TimeoutExpired:
        raise DeviceError(f"{PROGRAM} has not ended within {TIMEOUT_S:g} s; reset the board and try again") from None
    except OSError as error:
        raise DeviceError(f"{PROGRAM}: cannot be started: {error.strerror}") from None
