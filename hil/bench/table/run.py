"""One run for the HIL table: a master process with a slave for some seconds.

The definitions of the figures are in docs/explanation/benchmark.md.
"""

import json
import os
from math import isfinite
from typing import Any, NamedTuple

from hil.bench.floors import bare_slave
from hil.bench.harness import READY_S, Bench
from hil.bench.processes import resident_mib
from hil.bench.record import Figure
from hil.bench.report import Row
from hil.bench.table.hil_table import PAPER_BOARD_MIB
from hil.common.children import module_command
from hil.common.clock import seconds_ns
from hil.common.errors import NetworkError
from hil.common.ports import free_ports
from hil.network.roles import open_master_session
from hil.ros.diagnostics import Diagnostics, or_nan

BARE_S = 3.0  # of the measurement of the slave's CPU floor
FLEW = (0, 6)  # exit codes of a master that flew: the goal was reached, or not within the time


ROWS = (
    Row("master_cpu", "master CPU", "% of a core", "{:.2f}"),
    Row("startup", "start-up to the first sample", "s", "{:.3f}", is_clocked=True),
    Row("ready", "start-up to ready", "s", "{:.3f}"),
    Row("memory", "slave memory", "MiB", "{:.1f}"),
    Row("memory_alone", "slave memory, alone on its machine", "MiB", "{:.1f}"),
    Row("memory_share", "slave memory, share of the board's", "%", "{:.2f}"),
    Row("delay_p50", "command delay p50", "ms", "{:.3f}", is_clocked=True),
    Row("delay_p99", "command delay p99", "ms", "{:.3f}", is_clocked=True),
    Row("delay_max", "command delay max", "ms", "{:.3f}", is_clocked=True),
    Row("slave_cpu", "slave CPU", "% of a core", "{:.2f}"),
    Row("slave_cpu_floor", "waking and publishing alone", "% of a core", "{:.2f}", better=""),
)


class Run(NamedTuple):
    """Result of one repetition: the value of each row, the slave's diagnostics, `warnings` of wrong clocks."""

    values: dict[str, float]
    slave: Diagnostics
    notes: list[str]
    warnings: list[str]


def fly(bench: Bench, number: int, endpoint: str = "") -> Run:
    """Fly once. `endpoint` is that of a slave elsewhere; without it one is started here, after the master connects.

    Raises NetworkError.
    """
    folder = bench.file(f"run-{number}")
    master = bench.start_master("--output", folder, endpoint=endpoint)
    slave = None if endpoint else bench.start_slave()
    code = master.wait(bench.scenario.master.time_limit + 2 * READY_S)
    if slave and not slave.running:
        raise NetworkError(f"the slave {slave.ending}")
    alone_mib = resident_mib(slave.family()) if slave else float("nan")
    if slave:
        slave.stop()
    if code not in FLEW:
        raise NetworkError(f"the master {master.ending}")
    with open(os.path.join(folder, "table.json"), encoding="utf-8") as file:
        run = _read(json.load(file)["table"], alone_mib)
    run.values["slave_cpu_floor"] = float("nan") if endpoint else 100.0 * _bare_share(bench, run.slave)
    return run


def _bare_share(bench: Bench, slave: Diagnostics) -> float:
    """Return the share of a core that a process takes which only wakes and publishes as often as `slave`.

    Raises NetworkError.
    """
    settings = bench.scenario.slave
    endpoint = f"tcp/127.0.0.1:{free_ports(1)[0]}"
    rate = or_nan(slave.messages_sent) / or_nan(slave.uptime_s)
    arguments = endpoint, seconds_ns(settings.step), rate, BARE_S, int(settings.realtime)
    command = module_command("hil.bench.floors.bare_slave", *map(str, arguments))
    process = bench.start("bare", command, limited=True)
    with open_master_session(endpoint) as session:
        session.subscribe(bare_slave.NODE, "*", lambda *_: None, depth=100)
        output = process.expect("share", READY_S + BARE_S)
    process.wait(READY_S)
    return float(output.split()[1])


def figures(runs: list[Run]) -> dict[str, Figure]:
    """Return the rows of the table over some repetitions."""
    return {row.name: Figure([run.values[row.name] for run in runs], row.unit, row.better) for row in ROWS}


def _read(table: dict[str, Any], alone_mib: float) -> Run:
    def number(name: str, factor: float = 1.0) -> float:
        return float("nan") if table[name] is None else table[name] * factor

    if not isfinite(alone_mib):  # a slave elsewhere reports it itself
        alone_mib = number("slave_rss_mib")
    ram = min(number("slave_ram_mib"), PAPER_BOARD_MIB)
    values = {
        "master_cpu": number("master_cpu_core", 100.0),
        "startup": number("startup_s"),
        "ready": number("slave_ready_s"),
        "memory": number("slave_pss_mib"),
        "memory_alone": alone_mib,
        "memory_share": alone_mib * 100.0 / ram,
        "slave_cpu": number("slave_cpu_core", 100.0),
    }
    delay = {key: float("nan") if value is None else value for key, value in table["delay"].items()}
    values |= {f"delay_{name}": delay[f"{name}_ms"] for name in ("p50", "p99", "max")}
    return Run(values, Diagnostics(table["slave"]), [*table["events"], *table["notes"]], table["warnings"])
