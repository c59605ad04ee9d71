"""Compile the firmware in C.

    python -m firmware_stub.build                                   rebuilds the shipped images, bit by bit the same
    python -m firmware_stub.build --chip f405 --crystal 12 --output my_board    builds one for a 12 MHz crystal

    src/*.c, include/*.h      the core, for any machine
    src/stm32/                common to all STM32: needs arm-none-eabi-gcc
    src/stm32f1/, stm32f4/    a family of STM32: clocks, pins
    src/f103/, f405/ ...      a chip: frequencies, pins, memory
    src/native/               a Linux process: needs any C compiler
    images/*.bin, *.toml      the image for each chip; its wiring, and how it was built

MAVLink needs pymavlink at compile time, and nothing at run time.
"""

import argparse
import hashlib
import json
import os
import shlex
import shutil
import subprocess
import sys
from typing import NamedTuple

from firmware_stub import mavlink_headers
from firmware_stub.image import CHIPS, IMAGES, image_path
from hil.common.errors import ConfigError, DeviceError, HilError
from hil.common.scratch import ScratchFolder

HERE = os.path.dirname(os.path.abspath(__file__))

CORE = ("board.c", "stream.c", "frame.c", "vesc.c", "firmware.c")
MAVLINK, NO_MAVLINK = ("mavlink.c",), ("without_mavlink.c",)
NATIVE = "native/main.c"
STM32 = ("startup.c", "main.c", "clock.c", "parameters.c", "pwm.c", "uart.c")
FAMILY = ("rcc.c", "pins.c")
# chip -> its family, its core, whether it has CAN
PARTS = {
    "f103": ("stm32f1", "cortex-m3", True),
    "f405": ("stm32f4", "cortex-m4", True),
    "f411": ("stm32f4", "cortex-m4", False),
    "f446": ("stm32f4", "cortex-m4", True),
}

WARNINGS = ["-std=c11", "-Wall", "-Wextra", "-Wconversion", "-Werror"]
ARM = "arm-none-eabi-gcc"
# Soft floats: interrupts are faster without FPU registers to save, and only one message has floats.
ARM_FLAGS = ["-mthumb", "-mfloat-abi=soft", "-Os", "-ffreestanding", "-nostdlib"]
ARM_FLAGS += ["-ffunction-sections", "-fdata-sections", "-Wl,--gc-sections", "-Wl,--build-id=none"]


class Image(NamedTuple):
    """Firmware image for an STM32: the program for a debugger (ELF), and the contents of the flash."""

    elf: str
    binary: str


def native_compiler() -> list[str]:
    """Return the command of this machine's C compiler: CC of the environment, or cc. Raises DeviceError."""
    command = shlex.split(os.environ.get("CC", "")) or ["cc"]
    if not shutil.which(command[0]):
        raise DeviceError(f"no C compiler {command[0]!r} for the native STM32: sudo apt install gcc libc6-dev")
    return command


def compile_core(target: str, sources: list[str], compiler: list[str], mavlink: bool) -> str:
    """Compile the core and further `sources` into `target`, with MAVLink or without; return `target`.

    Raises DeviceError with the compiler's first error; MissingExtraError if MAVLink is wanted without pymavlink.
    """
    core = [_source(name) for name in (*CORE, *(MAVLINK if mavlink else NO_MAVLINK))]
    with ScratchFolder("headers") as headers:
        if mavlink:
            mavlink_headers.make_headers(headers.path)
        include = [f"-I{os.path.join(HERE, 'include')}", "-isystem", headers.path]
        _run([*compiler, *WARNINGS, *include, *core, *sources, "-o", target])
    return target


def compile_native(target: str, mavlink: bool) -> str:
    """Compile the firmware as a process into the program `target`; raises as `compile_core` does."""
    return compile_core(target, [_source(NATIVE)], [*native_compiler(), "-O2"], mavlink)


def compile_image(folder: str, chip: str, crystal: int | None = None) -> Image:
    """Compile the image for a chip into `folder`. crystal: that of the board in MHz; None: as in the shipped image.

    Raises ConfigError for an unknown chip, DeviceError without a compiler for Arm, MissingExtraError without pymavlink.
    """
    binary = os.path.join(folder, os.path.basename(image_path(chip)))
    if not shutil.which(ARM):
        raise DeviceError(f"no {ARM} for the STM32's image: sudo apt install --no-install-recommends gcc-arm-none-eabi")
    image = Image(binary.removesuffix(".bin") + ".elf", binary)
    family, core, has_can = PARTS[chip]
    names = [f"stm32/{name}" for name in (*STM32, "can.c" if has_can else "no_can.c")]
    names += [f"{family}/{name}" for name in FAMILY]
    place = [f"-I{_source(name)}" for name in (chip, family, "stm32")]
    place += ["-isystem", _source("stm32/freestanding"), f"-L{_source('stm32')}", "-T", _source(f"{chip}/chip.ld")]
    flags = [f"-mcpu={core}", *ARM_FLAGS, *([] if crystal is None else [f"-DHSE_MHZ={crystal}u"])]
    compile_core(image.elf, [*map(_source, names), *place, "-lgcc"], [ARM, *flags], mavlink=True)
    _run(["arm-none-eabi-objcopy", "-O", "binary", image.elf, image.binary])
    os.chmod(image.binary, 0o644)
    return image


def image_sources(chip: str) -> list[str]:
    """Return the source files of the image for a chip."""
    return sources("include", "src", "src/stm32", "src/stm32/freestanding", f"src/{PARTS[chip][0]}", f"src/{chip}")


def recipe(binary: str, chip: str) -> dict[str, str | int]:
    """Return what determines the bytes of a built image (compiler, pymavlink, sources), its size and SHA-256."""
    version = subprocess.run([ARM, "--version"], check=True, capture_output=True, text=True).stdout.splitlines()[0]
    return {
        "compiler": version,
        "pymavlink": mavlink_headers.version() or "",
        "sources": fingerprint(image_sources(chip)),
        "size": os.path.getsize(binary),
        "sha256": fingerprint([binary]),
    }


def sources(*folders: str) -> list[str]:
    """Return the C files and linker scripts in these folders of this package, sorted."""
    paths = [os.path.join(HERE, folder, name) for folder in folders for name in os.listdir(os.path.join(HERE, folder))]
    return sorted(path for path in paths if path.endswith((".c", ".h", ".ld")))


def fingerprint(paths: list[str]) -> str:
    """Return the SHA-256 of the contents of these files."""
    digest = hashlib.sha256()
    for path in paths:
        with open(path, "rb") as file:
            digest.update(file.read())
    return digest.hexdigest()


def _source(name: str) -> str:
    return os.path.join(HERE, "src", name)


def _run(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        lines = done.stderr.splitlines() or ["no message"]  # the linker's reason has no such word
        errors = [line for line in lines if "error:" in line and not line.startswith("collect2")] or lines
        raise DeviceError(f"{command[0]}: {errors[0].strip()}")


def description(chip: str, made_by: dict[str, str | int]) -> str:
    """Return the text of the .toml beside an image: how it was built, then the wiring of its chip."""
    lines = [f"{key} = {json.dumps(value)}\n" for key, value in made_by.items()]
    with open(_source(f"{chip}/chip.toml"), encoding="utf-8") as file:
        wiring = file.read()
    return "".join([f"# How uuv_hil_stm32{chip}.bin was made: python -m firmware_stub.build\n", *lines, "\n", wiring])


def make_image(folder: str, chip: str, crystal: int | None = None) -> Image:
    """Compile the image for a chip into `folder`, with its description beside it; raises as `compile_image` does."""
    image = compile_image(folder, chip, crystal)
    made_by = recipe(image.binary, chip) | ({} if crystal is None else {"crystal": crystal})
    with open(image.binary.removesuffix(".bin") + ".toml", "w", encoding="utf-8") as file:
        file.write(description(chip, made_by))
    return image


def _ship(chip: str) -> None:
    with ScratchFolder("image") as folder:
        made = make_image(folder.path, chip).binary.removesuffix(".bin")
        for ending in (".bin", ".toml"):
            shutil.copyfile(made + ending, image_path(chip).removesuffix(".bin") + ending)
    print(f"{image_path(chip)}: {os.path.getsize(image_path(chip))} bytes")


def main(argv: list[str] | None = None) -> None:
    """Compile the shipped images, or a custom one."""
    parser = argparse.ArgumentParser(
        prog="python -m firmware_stub.build", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--output", metavar="FOLDER", help=f"where to put other images than the shipped ones in {IMAGES}")
    add("--chip", choices=CHIPS, help="one chip instead of all")
    add("--crystal", metavar="MHZ", type=int, choices=range(4, 27), help="that of the board, instead of the usual one")
    options = parser.parse_args(argv)
    if options.crystal is not None and not (options.output and options.chip):
        raise ConfigError("another crystal: name the chip with --chip and where to put its image with --output")
    for chip in [options.chip] if options.chip else CHIPS:
        if options.output:
            os.makedirs(options.output, exist_ok=True)
            print(*make_image(options.output, chip, options.crystal), sep="\n")
        else:
            _ship(chip)


if __name__ == "__main__":
    try:
        main()
    except HilError as error:
        sys.exit(str(error))
