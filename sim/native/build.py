"""Compile the C twins of what runs in a slave's loop: `python -m sim.native.build` puts each beside its source.

A C compiler and the headers of this Python are all it takes. The binaries serve CPython 3.11 and later.
"""

import os
import shlex
import shutil
import subprocess
import sys
import sysconfig

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BINARY, RAYS, CONTROL = "sim/native/_native.abi3.so", "sim/native/_rays.abi3.so", "hil/slave/native/_control.abi3.so"
SOURCES = {binary: f"{binary.partition('.')[0]}.c" for binary in (BINARY, RAYS, CONTROL)}  # below the project's folder
# Bit equality with Python hangs on the second: gcc fuses multiply and add on aarch64 unless told not to.
FLAGS = ["-O2", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-shared", "-Wall", "-Wextra"]


def compiler() -> list[str] | None:
    """The C compiler as a command: CC of the environment, the one Python was built with, or cc."""
    for command in (os.environ.get("CC"), sysconfig.get_config_var("CC"), "cc"):
        words = shlex.split(command or "")
        if words and shutil.which(words[0]):
            return words
    return None


def obstacle() -> str | None:
    """Why there can be no C twin here, if so."""
    if sys.platform != "linux" or sys.implementation.name != "cpython":
        return "it is for CPython on Linux"
    if sysconfig.get_config_var("Py_GIL_DISABLED"):
        return "a free-threaded Python has no stable ABI"
    return None if compiler() else "no C compiler (sudo apt install gcc)"


def build(folder: str) -> str | None:
    """Compile into `folder`, each where it belongs; None if that worked, else the reason in one line."""
    command, reason = compiler(), obstacle()
    if reason or not command:
        return reason
    for binary, source in SOURCES.items():
        reason = reason or _compile(command, os.path.join(ROOT, source), os.path.join(folder, binary))
    return reason


def _compile(command: list[str], source: str, target: str) -> str | None:
    # Renamed when complete: a process that runs on the old one keeps it.
    new = f"{target}.{os.getpid()}"
    os.makedirs(os.path.dirname(target), exist_ok=True)
    include = sysconfig.get_path("include")
    done = subprocess.run(
        [*command, *FLAGS, f"-I{include}", source, "-o", new, "-lm"], capture_output=True, text=True, check=False
    )
    if done.returncode:
        errors = [line for line in done.stderr.splitlines() if "error" in line] or ["no message"]
        return f"{command[0]}: {errors[0].strip()} (Python.h comes with: sudo apt install python3-dev)"
    os.replace(new, target)
    return None


if __name__ == "__main__":
    problem = build(ROOT)
    sys.exit(f"not built: {problem}" if problem else 0)
