"""Broken and hostile files: the program has to end soon, with one clear line and exit code 2."""

import os
import random
import resource
import subprocess
import time
from collections.abc import Callable
from math import nan
from pathlib import Path
from typing import NamedTuple

from hil.common.children import module_command, package_environment
from tools.faults.rows import Row, judge

PATIENCE_S = 60.0
MEMORY_MIB = 2048  # limit for a program that reads a file of some kilobytes
HEAD = 'vehicle = "paper_six"\nworld = "open_water"\n[start]\ndepth = 5\n[master]\ngoal = [1, 1]\n'


class BadFile(NamedTuple):
    """A file: its `suffix`, the function that makes its content, and the command that reads it as {file}.

    words: text that must be in the error, so that the file is not refused for another reason.
    """

    name: str
    message: str
    suffix: str
    make: Callable[[random.Random], bytes]
    command: tuple[str, ...]


SLAVE = ("slave", "{file}")
BUILD = ("world", "build", "-o", "{folder}/built", "{file}")
CHECK = ("recording", "replay", "--check", "{file}")
PLOT = ("recording", "plot", "-o", "{folder}", "{file}")
READ_ONLY = '[recording]\nslave = true\nfolder = "/sys/uuv-hil"\n[slave]\nlisten = "tcp/127.0.0.1:29871"\n'


def _scenario(name: str, message: str, text: str) -> BadFile:
    return BadFile(name, message, ".toml", lambda _: text.encode(), SLAVE)


BAD_FILES = (
    _scenario("scenario that is not TOML", "not valid TOML", "vehicle = [\n"),
    BadFile("scenario of random bytes", "not UTF-8 text", ".toml", lambda r: r.randbytes(4096), SLAVE),
    _scenario("scenario nested 20,000 deep", "more than 32 deep", HEAD + "x = " + "[" * 20_000),
    _scenario("scenario with inf", "deadman: inf", f"{HEAD}[slave]\ndeadman = inf\n"),
    _scenario("scenario, number of 100,000 digits", "more than 4300 digits", "seed = " + "9" * 100_000),
    _scenario("scenario with an unknown key", "deadmen", f"{HEAD}[slave]\ndeadmen = 1\n"),
    _scenario("scenario, 50 commands/s on 9600 Bd", "faults.baud: 9600", f"{HEAD}[link]\nfaults = {{ baud = 9600 }}\n"),
    _scenario("recording in a read-only folder", "cannot be made", HEAD + READ_ONLY),
    BadFile("chart of random bytes", "not an ISO 8211", ".000", lambda r: r.randbytes(65_536), BUILD),
    BadFile("chart cut short", "cut off", ".000", lambda _: b"009623LE1 0900201 ! 3404", BUILD),
    BadFile("chart, a contour over half the earth", "far outside of its coverage", ".000", lambda _: _far(), BUILD),
    BadFile("GeoTIFF of random bytes", "cannot be read", ".tif", lambda r: b"II*\0" + r.randbytes(65_536), BUILD),
    BadFile("soundings that are not numbers", "columns", ".xyz", lambda _: b"1 2 three\n" * 100, BUILD),
    BadFile("recording of random bytes", "not an MCAP", ".mcap", lambda r: r.randbytes(65_536), CHECK),
    BadFile("recording cut after its head", "not an MCAP", ".mcap", lambda _: b"\x89MCAP0\r\n", PLOT),
)


def _far() -> bytes:
    """Return a chart with one position of a contour off by 45 degrees: 160,000 points to interpolate."""
    from tests.support.charts.small_cell import bay

    cell = bay()
    cell.line(43, [(54.004, 10.0), (54.004, 55.0), (54.004, 10.016)], VALDCO=10)
    return cell.data()


def measure_file(bad: BadFile, folder: Path) -> Row:
    """Run the program with the file; return a row without outputs, whose recovery is the time until it ended."""
    path = folder / f"bad{bad.suffix}"
    path.write_bytes(bad.make(random.Random(1)))
    command = [word.format(file=path, folder=folder) for word in bad.command]
    began = time.monotonic()
    try:
        completed = subprocess.run(
            module_command("hil.cli", *command), env=package_environment(), capture_output=True, text=True, check=False,
            timeout=PATIENCE_S, preexec_fn=_limit_memory, cwd=folder,
        )  # fmt: skip
        code, output = completed.returncode, (completed.stderr + completed.stdout).strip()
    except subprocess.TimeoutExpired:
        code, output = None, "still running"
    took_s = time.monotonic() - began
    lines = output.splitlines() or [""]
    problems = []
    if code != 2:
        problems.append(f"exit code {code}, not 2")
    if "Traceback" in output or len(lines) > 3:
        problems.append(f"{len(lines)} lines instead of a clear one")
    if bad.message not in output:
        problems.append(f"refused for another reason than {bad.message!r}")
    path.unlink()
    left = sorted(name for name in os.listdir(folder) if name.startswith(("bad", "built")))
    reported = lines[-1].replace(str(folder), "...")[:200]
    row = Row(
        "file", bad.name, f"uuv-hil {bad.command[0]}", nan, nan, took_s, 0, reported, " ".join(left), tuple(problems)
    )
    return judge(row)


def _limit_memory() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_MIB << 20, MEMORY_MIB << 20))
