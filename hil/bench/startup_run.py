"""Measure a slave's start, phase by phase, cold and warm, beside empty interpreters."""

import os
import sysconfig
from collections.abc import Iterable
from importlib.util import find_spec

from hil.bench.harness import Bench, await_vehicle
from hil.common.children import ROOT, python_command
from hil.common.clock import NS_PER_MS, now_ns, to_wall_ns
from hil.common.errors import NetworkError
from hil.ros.diagnostics import or_nan

# The instants that the slave reports, and the phase that ends with each.
PHASES = {
    "python": "interpreter",
    "scenario": "scenario",
    "imports": "imports",
    "simulator": "simulator",
    "link": "thruster link",
    "session": "network session",
    "ready": "first step",
}
AT_MASTER = "first sample at the master"
LISTENED = ("odom",)  # as in a master that flies; another topic's sample may arrive earlier


def phases(ends: dict[str, float]) -> dict[str, float]:
    """Return the duration of each phase from the times at which they end, in order; all in ms."""
    return {name: end - before for (name, end), before in zip(ends.items(), (0.0, *ends.values()), strict=False)}


def start(bench: Bench) -> dict[str, float]:
    """Start a slave while a master connects, and end both; return the duration of each phase, and of "all", in ms.

    All ends with the first sample at the master. Raises NetworkError.
    """
    with bench.client(topics=LISTENED) as client:
        slave = bench.start_slave()
        await_vehicle(client, slave)
        health = client.diagnostics()
        sample = ((client.first_sample_ns(0) or 0) - to_wall_ns(slave.exec_ns)) / NS_PER_MS
        ends = {title: or_nan(health[f"startup_{name}_ms"]) for name, title in PHASES.items()}
        slave.stop()
    took = phases({**dict(sorted(ends.items(), key=lambda end: end[1])), AT_MASTER: sample})
    return {**{name: took[name] for name in (*PHASES.values(), AT_MASTER)}, "all": sample}


def floors() -> dict[str, str]:
    """Return the code that interpreters run for comparison, by name; with numpy where it is installed."""
    programs = {"bare interpreter": "pass"}
    if find_spec("numpy"):
        programs["numpy and zenoh"] = "import numpy, zenoh"
    return programs


def time_floor(bench: Bench, code: str) -> float:
    """Return the time (ms) from exec to end of an interpreter that runs `code` under the slave's limits.

    Raises NetworkError when it fails.
    """
    process = bench.start("floor", python_command("-c", code), limited=True)
    failed = process.join()
    took = (now_ns() - process.exec_ns) / NS_PER_MS
    if failed:
        raise NetworkError(f"python -c {code!r} failed: {process.last_line}")
    return took


def files_of_a_start() -> list[str]:
    """Return the files that the slave and the floors may read: those of Python's libraries and of this project."""
    packages = (os.path.join(ROOT, name) for name in ("hil", "sim", "boards", "firmware_stub"))
    folders = (*(sysconfig.get_path(name) for name in ("stdlib", "platlib")), *packages)
    walked = (each for folder in folders for each in os.walk(folder))  # one may be within another
    return [*dict.fromkeys(os.path.join(path, name) for path, _, names in walked for name in names)]


def drop(files: Iterable[str]) -> None:
    """Drop files from the page cache, so that the next start is cold; those that cannot be opened stay."""
    for path in files:
        try:
            descriptor = os.open(path, os.O_RDONLY)
        except OSError:
            continue
        try:
            os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
        finally:
            os.close(descriptor)
