"""Compile the firmware in C.

    python -m firmware_stub.build                                   makes the shipped image again, bit for bit
    python -m firmware_stub.build --crystal 12 --output my_board    another image, for a board with that crystal

    src/*.c, include/*.h      the core, for any machine
    src/f405/                 the STM32F405: needs arm-none-eabi-gcc
    src/native/               a Linux process: needs any C compiler
    images/*.bin, *.toml      the image for the STM32F405, and the recipe that it was made by

MAVLink needs pymavlink when it is compiled, nothing when it runs.
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
from firmware_stub.image import IMAGE
from hil.common.errors import DeviceError, HilError
from hil.common.scratch import ScratchFolder

HERE = os.path.dirname(os.path.abspath(__file__))
RECIPE = os.path.join(HERE, "images", "uuv_hil_stm32f405.toml")

CORE = ("board.c", "stream.c", "frame.c", "vesc.c", "firmware.c")
MAVLINK, NO_MAVLINK = ("mavlink.c", "mavlink_answers.c"), ("without_mavlink.c",)
NATIVE = ("native/main.c", "native/pty.c")
F405 = ("startup.c", "main.c", "clock.c", "parameters.c", "pwm.c", "uart.c", "can.c")

WARNINGS = ["-std=c11", "-Wall", "-Wextra", "-Wconversion", "-Werror"]
ARM = "arm-none-eabi-gcc"
# Without an FPU's registers an interrupt costs less, and the one message with floats is not worth them.
ARM_FLAGS = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=soft", "-Os", "-ffreestanding", "-nostdlib"]
ARM_FLAGS += ["-ffunction-sections", "-fdata-sections", "-Wl,--gc-sections", "-Wl,--build-id=none"]


class Image(NamedTuple):
    """Firmware image for the STM32F405: the program for a debugger (ELF), and the contents of the flash."""

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
    return compile_core(target, [_source(name) for name in NATIVE], [*native_compiler(), "-O2"], mavlink)


def compile_image(folder: str, crystal: int = 8) -> Image:
    """Compile the image into `folder`, for a board with a crystal of `crystal` MHz (4 to 26).

    Raises DeviceError without a compiler for Arm; MissingExtraError without pymavlink.
    """
    if not shutil.which(ARM):
        raise DeviceError(f"no {ARM} for the STM32's image: sudo apt install --no-install-recommends gcc-arm-none-eabi")
    image = Image(os.path.join(folder, "uuv_hil_stm32f405.elf"), os.path.join(folder, os.path.basename(IMAGE)))
    here = _source("f405")
    sources = [os.path.join(here, name) for name in F405]
    place = [f"-I{here}", "-isystem", os.path.join(here, "freestanding"), "-T", os.path.join(here, "f405.ld")]
    compile_core(image.elf, [*sources, *place, "-lgcc"], [ARM, *ARM_FLAGS, f"-DHSE_MHZ={crystal}u"], mavlink=True)
    _run(["arm-none-eabi-objcopy", "-O", "binary", image.elf, image.binary])
    os.chmod(image.binary, 0o644)
    return image


def recipe(binary: str) -> dict[str, str | int]:
    """Return what decides the bytes of an image made here, and a fingerprint of those bytes."""
    version = subprocess.run([ARM, "--version"], check=True, capture_output=True, text=True).stdout.splitlines()[0]
    return {
        "compiler": version,
        "pymavlink": mavlink_headers.version() or "",
        "sources": fingerprint(sources("include", "src", "src/f405", "src/f405/freestanding")),
        "size": os.path.getsize(binary),
        "sha256": fingerprint([binary]),
    }


def sources(*folders: str) -> list[str]:
    """Return the files in C of these folders of this package, and the linker's script."""
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
        errors = [line for line in done.stderr.splitlines() if "error" in line] or ["no message"]
        raise DeviceError(f"{command[0]}: {errors[0].strip()}")


def _ship() -> None:
    with ScratchFolder("image") as folder:
        shutil.copyfile(compile_image(folder.path).binary, IMAGE)
    lines = [f"{key} = {json.dumps(value)}\n" for key, value in recipe(IMAGE).items()]
    with open(RECIPE, "w", encoding="utf-8") as file:
        file.writelines(["# What uuv_hil_stm32f405.bin was made with: python -m firmware_stub.build\n", *lines])
    print(f"{IMAGE}: {os.path.getsize(IMAGE)} bytes")


def main(argv: list[str] | None = None) -> None:
    """Compile the shipped image, or another one."""
    parser = argparse.ArgumentParser(
        prog="python -m firmware_stub.build", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--output", metavar="FOLDER", help="where to put another image; it has to exist")
    parser.add_argument("--crystal", metavar="MHZ", type=int, choices=range(4, 27), default=8, help="its board's [8]")
    options = parser.parse_args(argv)
    if options.output:
        print(*compile_image(options.output, options.crystal), sep="\n")
    elif options.crystal == 8:
        _ship()
    else:
        parser.error("the shipped image is for 8 MHz: say where to put another one with --output")


if __name__ == "__main__":
    try:
        main()
    except HilError as error:
        sys.exit(str(error))
