"""The extension modules in C: their names, their sources, and how they are compiled.

`python c_extensions.py` puts each beside its source. hatch_build.py does it when a wheel or a clone is installed.
A C compiler and the headers of this Python are needed. The binaries serve CPython 3.10 and later.
"""

import os
import shlex
import shutil
import subprocess
import sys
import sysconfig

ROOT = os.path.dirname(os.path.abspath(__file__))
# The binaries, and what they are made of besides the source of the same name; all below this folder.
BINARY, RAYS = "sim/native/_native.abi3.so", "sim/native/_rays.abi3.so"
PICTURE = "sim/native/_picture.abi3.so"
FIRMWARE = "hil/slave/native/_firmware.abi3.so"
CORE = ("board", "firmware", "frame", "stream", "vesc", "without_mavlink")
SOURCES: dict[str, list[str]] = {BINARY: [], RAYS: [], PICTURE: []}
SOURCES[FIRMWARE] = [f"firmware_stub/src/{name}.c" for name in CORE]
HEADERS = "firmware_stub/include"
# Bit equality with Python hangs on the second: gcc fuses multiply and add on aarch64 unless told not to.
FLAGS = ["-O3", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-shared", "-Wall", "-Wextra"]
# What gcc 14 and later refuse by themselves, earlier ones refuse as well.
FLAGS += ["-Werror=implicit-function-declaration", "-Werror=implicit-int"]
FLAGS += ["-Werror=incompatible-pointer-types", "-Werror=int-conversion"]


def module(binary: str) -> str:
    """Return the name under which one of SOURCES is imported."""
    return binary.partition(".")[0].replace("/", ".")


def compiler() -> list[str] | None:
    """Return the C compiler as a command: CC of the environment, the one Python was built with, or cc."""
    for command in (os.environ.get("CC"), sysconfig.get_config_var("CC"), "cc"):
        words = shlex.split(command or "")
        if words and shutil.which(words[0]):
            return words
    return None


def source_bytes(folder: str) -> int:
    """Return the size (bytes) of a folder's C, by which `sim.native.load` knows a binary of other sources."""
    return sum(file.stat().st_size for file in os.scandir(folder) if file.name.endswith((".c", ".h")))


def unavailable_reason() -> str | None:
    """Return why nothing can be compiled here; None if it can be."""
    if sys.platform != "linux" or sys.implementation.name != "cpython":
        return "it is for CPython on Linux"
    if sysconfig.get_config_var("Py_GIL_DISABLED"):
        return "a free-threaded Python has no stable ABI"
    return None if compiler() else "no C compiler (sudo apt install gcc python3-dev)"


def build(folder: str) -> str | None:
    """Compile into `folder`, each where it belongs; None if that worked, else the reason in one line."""
    command, reason = compiler(), unavailable_reason()
    if reason or not command:
        return reason
    for binary, others in SOURCES.items():
        sources = [f"{binary.partition('.')[0]}.c", *others]
        reason = reason or _compile(command, sources, os.path.join(folder, binary))
    return reason


def _compile(command: list[str], sources: list[str], target: str) -> str | None:
    # Renamed when complete: a process that runs on the old one keeps it.
    new = f"{target}.{os.getpid()}"
    os.makedirs(os.path.dirname(target), exist_ok=True)
    folders = [f"-I{folder}" for folder in (sysconfig.get_path("include"), os.path.join(ROOT, HEADERS))]
    paths = [os.path.join(ROOT, source) for source in sources]
    mark = f'-DSOURCE_BYTES="{source_bytes(os.path.dirname(paths[0]))}"'
    done = subprocess.run(
        [*command, *FLAGS, mark, *folders, *paths, "-o", new, "-lm"], capture_output=True, text=True, check=False
    )
    if done.returncode:
        errors = [line for line in done.stderr.splitlines() if "error" in line] or ["no message"]
        return f"{command[0]}: {errors[0].strip()} (Python.h comes with: sudo apt install python3-dev)"
    os.replace(new, target)
    return None


if __name__ == "__main__":
    failure = build(ROOT)
    sys.exit(f"not built: {failure}" if failure else 0)
