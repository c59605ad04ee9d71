"""`uuv-hil doctor`: what this machine has of what a run wants. It changes nothing."""

import os
import platform
import resource
import subprocess
import sys
from collections.abc import Iterator
from importlib import metadata
from importlib.util import cache_from_source

from hil import __version__
from hil.commands.parser import new_parser
from hil.commands.slave import LOOP_PRIORITY
from hil.errors import ConfigError

EXAMPLES = """\
Nothing that it finds is an error: the exit code is 0.

examples:
  uuv-hil doctor                      on the card computer, before the first run
  UUV_HIL_NATIVE=0 uuv-hil doctor     what the step would be
"""
ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
PACKAGES = ("hil", "sim", "boards", "firmware_stub")
# name, distribution, what it is for
LIBRARIES = (
    ("zenoh", "eclipse-zenoh", "the network between slave and master"),
    ("pyserial", "pyserial", "serial ports"),
    ("numpy", "numpy", "the master's maps"),
)


def main(arguments: list[str]) -> int:
    """Print one line for each thing looked at; 0."""
    new_parser("doctor", __doc__, EXAMPLES).parse_args(arguments)
    for name, finding in findings():
        print(f"{name:11} {finding}", flush=True)
    return 0


def findings() -> Iterator[tuple[str, str]]:
    """What is looked at and what is found, in words."""
    yield "uuv-hil", f"{__version__}, {ROOT}"
    yield "Python", f"{platform.python_version()}, {sys.executable}"
    for name, distribution, purpose in LIBRARIES:
        yield name, library(distribution, purpose)
    yield "step", step()
    yield "bytecode", bytecode(ROOT)
    yield "board", board()
    yield from realtime()
    yield "lock limit", lock_limit(resource.getrlimit(resource.RLIMIT_MEMLOCK)[0])
    for port in serial_ports():
        yield "serial port", port


def library(distribution: str, purpose: str) -> str:
    """The version of an installed distribution, or how to get it."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return f"not installed; it is for {purpose} (pip install {distribution})"


def step() -> str:
    """Which step of the dynamics is taken, and why."""
    from sim.native import choose

    try:
        return choose()[1]
    except ConfigError as error:
        return str(error)


def bytecode(root: str) -> str:
    """Whether the modules of the packages below `root` are compiled: else the first start takes longer."""
    missing = total = 0
    for package in PACKAGES:
        for folder, _, files in os.walk(os.path.join(root, package)):
            sources = [os.path.join(folder, name) for name in files if name.endswith(".py")]
            total += len(sources)
            missing += sum(not _is_compiled(source) for source in sources)
    if not missing:
        return f"compiled, {total} modules"
    folders = " ".join(os.path.join(root, package) for package in PACKAGES)
    return f"{missing} of {total} modules are not compiled (python -m compileall -q {folders})"


def _is_compiled(source: str) -> bool:
    """By the header of the cached file: flags, then time and size of the source (PEP 552)."""
    try:
        with open(cache_from_source(source), "rb") as file:
            header = file.read(16)
        found = os.stat(source)
    except OSError:
        return False
    flags, time_s, size = (int.from_bytes(header[i : i + 4], "little") for i in (4, 8, 12))
    return bool(flags) or (time_s, size) == (int(found.st_mtime) & 0xFFFFFFFF, found.st_size & 0xFFFFFFFF)


def board() -> str:
    """The card computer, or what else this is."""
    from boards import detect

    here = detect()
    if here:
        return f"{here.name}, {here.cpu}, UART {here.uart or 'unknown'}"
    return f"none of those known; {platform.machine()}, {os.cpu_count()} cores, Linux {platform.release()}"


def realtime() -> Iterator[tuple[str, str]]:
    """What the slave would be granted: asked for as the slave does, in a process of its own."""
    code = f"from hil import clock; print(clock.schedule_fifo({LOOP_PRIORITY})); print(clock.lock_memory())"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, env=os.environ | {"PYTHONPATH": ROOT}
    )
    for line in done.stdout.splitlines() or ["scheduling: could not be tried"]:
        name, _, finding = line.partition(": ")
        yield name, finding


def lock_limit(limit: int) -> str:
    """How much memory may be locked without the capability for it; `limit` in bytes, negative for no limit."""
    return "unlimited" if limit < 0 else f"{limit / 2**20:g} MiB (root and CAP_IPC_LOCK have none)"


def serial_ports() -> list[str]:
    """The ports of this machine, and whether this user may open them."""
    try:
        from serial.tools.list_ports import comports
    except ImportError:
        return ["unknown without pyserial"]
    return [_port(port.device, port.description) for port in sorted(comports())] or ["none found"]


def _port(device: str, description: str) -> str:
    known = f" ({description})" if description not in ("", "n/a") else ""
    allowed = os.access(device, os.R_OK | os.W_OK)
    return device + known + ("" if allowed else ": no permission (sudo usermod -aG dialout $USER, then log in again)")
