"""Measure start-up and memory of the slave beside a floor: `python -c "import numpy, zenoh"`, in one run.

    python tools/costs/startup.py [--runs 15]

The two run in turn. The slave is timed from its exec until its first line arrives, which says that the
session is open and the first step is made; the floor, as a command, until it has ended. The budgets: ready
in at most 0.6 times the floor, at most 40 MiB. Exit code 1 when one is missed. Compile bytecode first
(`make` does), and run nothing else meanwhile.
"""

import argparse
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from hil.common.children import module_command, package_environment, start_child  # noqa: E402

MAX_OF_FLOOR = 0.6
MAX_MIB = 40.0
FLOOR = [sys.executable, "-c", "import numpy, zenoh"]


def time_floor() -> float:
    """Return the duration of the floor in s."""
    began = time.perf_counter()
    subprocess.run(FLOOR, check=True, cwd=ROOT)
    return time.perf_counter() - began


def time_slave(command: list[str]) -> tuple[float, float]:
    """Start the slave, wait for its first line, and end it; return the time (s) and the memory (MiB) at that line."""
    began = time.perf_counter()
    with start_child(
        command, environment=package_environment(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    ) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        seconds = time.perf_counter() - began
        memory = psutil.Process(process.pid).memory_full_info().pss / 2**20
        process.terminate()
        process.communicate()
    if b"ready" not in line:
        sys.exit(f"{' '.join(command)}: {line.decode().strip()}")
    return seconds, memory


def slave_command(folder: str) -> list[str]:
    """Return the slave on a free port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    program = os.path.join(os.path.dirname(sys.executable), "uuv-hil")
    start = [program] if os.path.exists(program) else module_command("hil.cli")
    return [*start, "slave", "paper_field", "--listen", f"tcp/127.0.0.1:{port}", "--port", f"pty:{folder}/stm32"]


def main() -> int:
    """Measure and print; 1 when a budget is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=15, help="pairs of starts [%(default)s]")
    runs = parser.parse_args().runs
    slave: list[tuple[float, float]] = []
    floor: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(runs + 1):  # the first pair warms the caches and is not counted
            slave_s, floor_s = time_slave(slave_command(folder)), time_floor()
            if number:
                slave.append(slave_s)
                floor.append(floor_s)
            print(f"\r{number}/{runs}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    ready, base = statistics.median(seconds for seconds, _ in slave), statistics.median(floor)
    memory = statistics.median(mib for _, mib in slave)
    ratio = statistics.median(slave_s / floor_s for (slave_s, _), floor_s in zip(slave, floor, strict=True))
    print(f"slave ready       {ready * 1e3:6.1f} ms  (median of {runs})")
    print(f"numpy and zenoh   {base * 1e3:6.1f} ms")
    print(f"ratio             {ratio:6.2f}     budget {MAX_OF_FLOOR}")
    print(f"slave memory      {memory:6.1f} MiB  budget {MAX_MIB:.0f}")
    return int(ratio > MAX_OF_FLOOR or memory > MAX_MIB)


if __name__ == "__main__":
    sys.exit(main())
