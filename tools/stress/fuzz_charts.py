"""Read mutated S-57 cells as `uuv-hil world build` does, and report the results.

    python tools/stress/fuzz_charts.py                                 10,000 mutations of a small cell of the tests
    python tools/stress/fuzz_charts.py --charts DIR --count 1000       of the cells below a folder, such as NOAA's
    python tools/stress/fuzz_charts.py --charts DIR --count 100 --build     also grid them, within limits

Bytes are changed, inserted, cut out, doubled or swapped, digits of lengths and positions replaced, in the cell or in an
update beside it. Each cell is examined in a copy of this process (fork), which starts the process that reads it: about
a second. These are faults: an exception that is not a HilError, in the reading process or in its parent; an end of the
parent by a signal; a duration above `SLOWEST_S`; an error of several lines. With --build also: more than
twice the processor time or memory of the sound cell, or more than 1 GB. The exit code is 1 if there was a fault, and
the mutated cell is then stored.
"""

import argparse
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from hil.charts.build_process import read_and_build  # noqa: E402
from hil.charts.sources.combine import read_sources  # noqa: E402
from hil.common.errors import HilError  # noqa: E402

SLOWEST_S = 900.0  # by the clock, as others may use the processors; limits of processor time come before
MEMORY_BYTES = 4 << 30  # of address space, of the process that asks
RESOLUTION_M = 50.0
MOST_MIB = 1000.0  # to build a cell
GROWTH = 2.0  # greatest ratio of a mutated cell's time and memory to those of the sound one
SLACK_S = 1.0  # by which a busy machine may lengthen a short build
READ, REFUSED, RAISED = 0, 2, 1  # exit codes of the copy


class Cost(NamedTuple):
    """Processor time (s) and memory (MiB) of a process and those that it started."""

    seconds: float
    mebibytes: float


def _end(work: Any) -> None:
    """Run `work` and end this copy with its exit code, or with a traceback."""
    code = RAISED
    try:
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115 - as long as the process
        code = work()
        sys.stdout.flush()
    except BaseException:  # noqa: BLE001 - whatever it is
        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(code)


def _wait(pid: int, seconds: float) -> tuple[int, "Cost"]:
    """Return the exit code, negative for a signal, and what it cost. Raises subprocess.TimeoutExpired."""
    deadline = time.monotonic() + seconds
    while True:
        ended, status, usage = os.wait4(pid, os.WNOHANG)
        if ended:
            cost = Cost(usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024)
            return os.waitstatus_to_exitcode(status), cost
        if time.monotonic() > deadline:
            raise subprocess.TimeoutExpired(["reader"], seconds)
        time.sleep(0.001)


def mutated(data: bytes, chance: random.Random) -> bytes:
    """Return `data` with one to eight changes."""
    changed = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 4, 8))):
        at, size = chance.randrange(len(changed)), chance.choice((1, 1, 2, 5, 24, 200))
        digits = [i for i in range(at, min(at + 400, len(changed))) if 48 <= changed[i] <= 57]
        kind = chance.randrange(7)
        if kind == 0:
            changed[at] = chance.randrange(256)
        elif kind == 1:
            changed[at : at + size] = chance.randbytes(size)
        elif kind == 2:
            changed[at:at] = chance.randbytes(size)
        elif kind == 3 and len(changed) > 2 * size:
            del changed[at : at + size]
        elif kind == 4:
            changed[at:at] = changed[at : at + size]
        elif kind == 5:
            other = chance.randrange(len(changed))
            changed[at : at + size] = changed[other : other + size]
        for place in chance.sample(digits, min(len(digits), 3)) if kind == 6 else ():
            changed[place] = chance.choice(b"0123456789")
    return bytes(changed)


def read(path: str, build: bool) -> int:
    """Read the cell as for a world, and grid it if `build`, in this copy of the process; return its exit code."""
    try:
        if build:
            read_and_build([path])
        else:
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
            read_sources([path], None, RESOLUTION_M)
    except HilError as error:
        output = str(error)
        assert output.startswith(path[:-4]) or "C:" in output, output
        assert "\n" not in output, output
        assert len(output) < 1000, output
        assert not re.search(r"\w+Error: ", output), output  # the end of a traceback
        return REFUSED
    return READ


def examine(path: str, build: bool, sound: Cost | None = None) -> tuple[str, Cost]:
    """Return the verdict of a cell ("read", "refused", or a fault), and its cost; `sound`: cost of the sound cell."""
    pid = os.fork()
    if not pid:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        _end(lambda: read(path, build))
    try:
        code, cost = _wait(pid, SLOWEST_S)
    except subprocess.TimeoutExpired:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        return "HANGS", Cost(SLOWEST_S, 0.0)
    words = {READ: "read", REFUSED: "refused", RAISED: "RAISES"}
    verdict = words.get(code, f"ENDS WITH {code}")
    if sound and cost.seconds > GROWTH * sound.seconds + SLACK_S:
        verdict = "TAKES LONG"
    if sound and cost.mebibytes > min(MOST_MIB, GROWTH * sound.mebibytes):
        verdict = "TAKES MEMORY"
    return verdict, cost


def cells_of(folder: str) -> list[tuple[bytes, bytes]]:
    """Return each cell with its first update, if it has one."""
    if not folder:
        from tests.process.charts.test_s57 import update_of
        from tests.support.charts.small_cell import bay

        whole = bay()
        return [(whole.data(), update_of(whole).data())]
    paths = sorted(Path(folder).rglob("*.000"))
    updates = [path.with_suffix(".001") for path in paths]
    return [
        (path.read_bytes(), update.read_bytes() if update.exists() else b"")
        for path, update in zip(paths, updates, strict=True)
    ]


def main() -> int:
    """Mutate, read and count; return 1 if there was a fault."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000, metavar="N")
    parser.add_argument("--seed", type=int, default=1, metavar="N")
    parser.add_argument("--charts", default="", metavar="DIR")
    parser.add_argument("--build", action="store_true", help="grid the cells that can be read")
    parser.add_argument("--keep", default="mutated_cells", metavar="DIR", help="folder of the cells with a fault")
    options = parser.parse_args()
    cells = cells_of(options.charts)
    verdicts: Counter[str] = Counter()
    slowest = most = 0.0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "C.000"
        sound: dict[bytes, Cost] = {}
        for cell, _ in cells if options.build else ():
            path.write_bytes(cell)
            sound[cell] = examine(str(path), True)[1]
            print(f"sound cell of {len(cell)} bytes: {sound[cell].seconds:.1f} s, {sound[cell].mebibytes:.0f} MiB")
        for number in range(options.count):
            chance = random.Random(f"{options.seed}/{number}")
            cell, update = chance.choice(cells)
            of_update = bool(update) and chance.random() < 0.2
            path.write_bytes(cell if of_update else mutated(cell, chance))
            path.with_suffix(".001").unlink(missing_ok=True)
            if of_update:
                path.with_suffix(".001").write_bytes(mutated(update, chance))
            verdict, cost = examine(str(path), options.build, sound.get(cell))
            verdicts[verdict] += 1
            slowest, most = max(slowest, cost.seconds), max(most, cost.mebibytes)
            if verdict not in ("read", "refused"):
                shutil.copytree(folder, Path(options.keep) / str(number), dirs_exist_ok=True)
                print(
                    f"{number}: {verdict}, {cost.seconds:.1f} s, {cost.mebibytes:.0f} MiB: {options.keep}/{number}",
                    flush=True,
                )
    print(", ".join([f"{count} {verdict}" for verdict, count in sorted(verdicts.items())]), end="")
    print(f" of {options.count}; slowest {slowest:.2f} s, most memory {most:.0f} MiB")
    return int(bool(verdicts.keys() - {"read", "refused"}))


if __name__ == "__main__":
    sys.exit(main())
