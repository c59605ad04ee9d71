"""Measure how the memory of long-running processes grows: `python -m tools.stress.memory_run --hours 1`.

A slave is driven over MAVLink, recorded into one file, and viewed by one client for hours. Each minute the anonymous
memory of slave, MAVLink gateway, recorder and view is read; the slope of the straight line through the figures after
the first ten minutes is the growth. Pages of files are not counted: they become private when other programs end.
Writes a table, and exits with 1 if a process grows by more than the limit.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from pymavlink import mavutil

from hil.common.children import module_command
from hil.common.ports import free_ports
from tools.costs.view_cost import Viewers, viewed

WARM_UP_S = 600.0
SAMPLE_S = 60.0
COMMAND_S = 0.05
LIMIT_MIB = 1.0  # an hour


def main(arguments: list[str]) -> int:
    """Run for the time of `arguments` and print the table; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=1.0, help="duration [%(default)s]")
    options = parser.parse_args(arguments)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        processes, vehicle, viewers = _start(stack, folder)
        rows = _measure(processes, vehicle, options.hours * 3600.0)
        assert viewers.are_connected, "the view lost its client"
    times, figures = np.array(rows)[:, 0], np.array(rows)[:, 1:]
    return _report(list(processes), times, figures)


def _start(stack: ExitStack, folder: Path) -> tuple[dict[str, int], "mavutil.mavudp", Viewers]:
    slave, link = free_ports(2)
    endpoint = f"tcp/127.0.0.1:{slave}"
    commands = {
        "slave": ("slave", "open_water", "--listen", endpoint),
        "mavlink": ("gateway", "mavlink", "--connect", endpoint, "--endpoint", f"udpin:127.0.0.1:{link}"),
        "record": ("recording", "make", "--connect", endpoint, "--output", str(folder / "recording")),
    }
    processes = {}
    for name, words in commands.items():
        with (folder / f"{name}.log").open("w", encoding="utf-8") as log:
            started = subprocess.Popen([*module_command("hil.cli"), *words], stdout=log, stderr=log, cwd=folder)
        stack.callback(started.wait)
        stack.callback(started.terminate)
        processes[name] = started.pid
        time.sleep(3.0)
    view, address, token = stack.enter_context(viewed("--connect", endpoint))
    processes["view"] = view
    viewers = stack.enter_context(Viewers(1, address, token))
    return processes, mavutil.mavlink_connection(f"udpout:127.0.0.1:{link}", source_system=255), viewers


def _measure(processes: dict[str, int], vehicle: "mavutil.mavudp", seconds: float) -> list[tuple[float, ...]]:
    """Drive the vehicle in circles; return the time (s) and each process's anonymous memory (MiB), each minute."""
    rows: list[tuple[float, ...]] = []
    began, beat_s, arm_s = time.monotonic(), 0.0, 0.0
    while (passed := time.monotonic() - began) < seconds:
        if passed >= beat_s:
            vehicle.mav.heartbeat_send(6, 8, 0, 0, 0)
            beat_s = passed + 1.0
        if passed >= arm_s:
            vehicle.mav.command_long_send(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
            arm_s = passed + 30.0
        vehicle.mav.manual_control_send(1, 300, 0, 500, 100, 0)
        while vehicle.recv_msg():
            pass
        if passed >= SAMPLE_S * len(rows):
            rows.append((passed, *map(_anonymous_mib, processes.values())))
            print(" ".join([f"{passed / 60.0:6.1f} min", *[f"{mib:8.2f}" for mib in rows[-1][1:]]]), flush=True)
        time.sleep(COMMAND_S)
    return rows


def _anonymous_mib(pid: int) -> float:
    status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text(encoding="utf-8").splitlines())
    return int(status["RssAnon"].split()[0]) / 1024


def _report(names: list[str], times: "np.ndarray", figures: "np.ndarray") -> int:
    """Print the growth of each process; return 1 if one is above the limit."""
    warm = times >= min(WARM_UP_S, times[-1] / 3.0)
    slopes = np.polyfit(times[warm] / 3600.0, figures[warm], 1)[0]
    print("| process | anonymous memory at the end, MiB | growth, MiB an hour |\n|---|--:|--:|")
    for name, last, slope in zip(names, figures[-1], slopes, strict=True):
        print(f"| {name} | {last:.1f} | {slope:.2f} |")
    return int(max(slopes) > LIMIT_MIB)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
