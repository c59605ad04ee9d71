"""One run for the HIL table: a master process with a slave for some seconds.

The definitions of the figures are in docs/explanation/benchmark.md.
"""

import json
import os
from math import nan
from typing import NamedTuple

from hil.bench.floors import bare_slave
from hil.bench.harness import READY_S, Bench
from hil.bench.processes import resident_mib
from hil.bench.record import Figure
from hil.bench.table.hil_table import ROWS
from hil.common.children import module_command
from hil.common.clock import seconds_ns
from hil.common.errors import NetworkError
from hil.common.ports import free_ports
from hil.network.roles import open_master_session
from hil.ros.diagnostics import Diagnostics, or_nan

BARE_S = 3.0  # of the measurement of the slave's CPU floor
FLEW = (0, 6)  # exit codes of a master that flew: the goal was reached, or not within the time


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
    alone_mib = resident_mib(slave.family()) if slave else nan
    if slave:
        slave.stop()
    if code not in FLEW:
        raise NetworkError(f"the master {master.ending}")
    with open(os.path.join(folder, "table.json"), encoding="utf-8") as file:
        table = json.load(file)["table"]
    values = {name: nan if value is None else value for name, value in table["rows"].items()}
    if slave:  # one elsewhere reports its memory itself
        values["memory_share"] *= alone_mib / values["memory_alone"]
        values["memory_alone"] = alone_mib
    health = Diagnostics(table["slave"])
    values["slave_cpu_floor"] = nan if endpoint else 100.0 * _bare_share(bench, health)
    return Run(values, health, [*table["events"], *table["notes"]], table["warnings"])


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
