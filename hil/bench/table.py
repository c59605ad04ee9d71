"""The HIL table: the source paper's four figures for a run of ours, with what is behind them.

master CPU     processor time of the master process from its first command to its last, over that time,
               as a share of one core and of the whole machine
start-up       from the exec of the slave until the master has its first sensor sample
slave memory   proportional set size of all processes of the slave at the end of the run, and its share
               of the memory of the machine it runs on
command delay  from the master's publish until the STM32 end has applied the pulse widths
"""

import os
from math import isfinite
from typing import Any, NamedTuple

from hil.columns import aligned
from hil.master.client import VehicleClient
from hil.master.delay import HOPS, Quantiles, judge, quantiles
from hil.master.flight import Outcome
from hil.process import boot_id

# "Modular UUV Simulation Platform", Sensors 2022, 22(20), 8043, HIL table: a Raspberry Pi 4B and a Jetson Nano.
PAPER_MASTER_CPU = 0.42
PAPER_STARTUP_S = (3.2, 3.6)
PAPER_MEMORY = (0.37, 0.59)
PAPER_DELAY_S = (2.0, 1.9)
PAPER_BOARD_MIB = 4096.0  # the larger memory of its two boards, to compare a share with when ours is larger


class HilTable(NamedTuple):
    """The figures of one run. Shares are 0..1; nan where a figure could not be had, `notes` say why.

    `warnings` say why the delays, and with them the start-up, are not to be trusted: a clock is wrong.
    """

    master_cpu_core: float
    master_cpu_machine: float
    slave_cpu_core: float
    slave_cpu_machine: float
    startup_s: float
    slave_ready_s: float
    slave_pss_mib: float
    slave_rss_mib: float
    slave_ram_mib: float
    delay: Quantiles
    hops: dict[str, Quantiles]
    commands: int
    clock_offset_ms: float
    clock_uncertainty_ms: float
    bytecode_compiled: bool
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    slave: dict[str, str]


def build(client: VehicleClient, outcome: Outcome, first_cpu: tuple[float, float]) -> HilTable:
    """The table of a mission just flown.

    `first_cpu` is the slave's processor time and the master's clock (both s) when the mission began.
    """
    health = client.diagnostics()
    notes: list[str] = []
    delays = client.delays
    delays.same_clock = health.get("boot_id") == boot_id()
    offset_ns, uncertainty_ns = delays.offset_ns()
    if not delays.same_clock:
        notes.append(
            f"two machines: clock offset {offset_ns / 1e6:.3f} ms estimated from {len(delays)} exchanges, "
            f"known to +-{uncertainty_ns / 1e6:.3f} ms"
        )
    cpu_s, at_s = first_cpu
    slave_core = (_figure(health, "cpu_s") - cpu_s) / max(client.latest["diagnostics"].received_ns / 1e9 - at_s, 1e-9)
    return HilTable(
        master_cpu_core=outcome.cpu_s / outcome.duration,
        master_cpu_machine=outcome.cpu_s / outcome.duration / (os.cpu_count() or 1),
        slave_cpu_core=slave_core,
        slave_cpu_machine=slave_core / _figure(health, "cores"),
        startup_s=_startup_s(client, health, offset_ns, notes),
        slave_ready_s=_figure(health, "startup_ready_ms") / 1e3,
        slave_pss_mib=_figure(health, "pss_mib"),
        slave_rss_mib=_figure(health, "rss_mib"),
        slave_ram_mib=_figure(health, "ram_mib"),
        delay=quantiles(delays.totals_ns()),
        hops={name: quantiles(delays.hop_ns(index)) for index, name in enumerate(HOPS)},
        commands=len(delays),
        clock_offset_ms=offset_ns / 1e6,
        clock_uncertainty_ms=uncertainty_ns / 1e6,
        bytecode_compiled=health.get("bytecode_compiled") == "true",
        notes=tuple(notes),
        warnings=tuple(judge(delays)),
        slave=health,
    )


def _figure(health: dict[str, str], name: str) -> float:
    try:
        return float(health[name])
    except (KeyError, ValueError):
        return float("nan")


def _startup_s(client: VehicleClient, health: dict[str, str], offset_ns: int, notes: list[str]) -> float:
    exec_wall_ns = int(health.get("exec_wall_ns", 0)) - offset_ns
    if client.dialled_wall_ns > exec_wall_ns:
        notes.append("start-up not measured: the slave was running before this master (start the master first)")
        return float("nan")
    return (client.first_sample_wall_ns - exec_wall_ns) / 1e9


def render(table: HilTable) -> str:
    """The table as text for a terminal."""
    ram = min(table.slave_ram_mib, PAPER_BOARD_MIB)
    memory = table.slave_rss_mib / ram  # on a machine by itself it shares nothing
    delay = table.delay
    rows = [
        ("", "paper: Pi 4B, Jetson Nano", "this run", "better"),
        (
            "master CPU",
            f"{PAPER_MASTER_CPU:.0%}",
            f"{table.master_cpu_core:.1%} of a core, {table.master_cpu_machine:.1%} of the machine",
            _times(PAPER_MASTER_CPU, table.master_cpu_core),
        ),
        (
            "start-up",
            _pair(PAPER_STARTUP_S, "{:.1f} s"),
            f"{_told(table.startup_s, '{:.3f} s')} to the first sample ({table.slave_ready_s:.3f} s to ready)",
            _times(min(PAPER_STARTUP_S), table.startup_s),
        ),
        (
            "slave memory",
            _pair(PAPER_MEMORY, "{:.0%}"),
            f"{table.slave_rss_mib:.1f} MiB, {memory:.2%} of {ram / 1024:.0f} GiB ({table.slave_pss_mib:.1f} MiB PSS)",
            _times(min(PAPER_MEMORY), memory),
        ),
        (
            "command delay",
            _pair(PAPER_DELAY_S, "{:.1f} s"),
            f"p50 {_told(delay.p50_ms)}, p99 {_told(delay.p99_ms)}, max {_told(delay.max_ms, '{:.1f} ms')}",
            _times(min(PAPER_DELAY_S) * 1e3, delay.p50_ms),
        ),
        ("slave CPU", "-", f"{table.slave_cpu_core:.1%} of a core, {table.slave_cpu_machine:.1%} of the machine", ""),
    ]
    return "\n".join([*aligned(rows, rule=True), "", *_details(table)])


def _told(value: float, form: str = "{:.2f} ms") -> str:
    return form.format(value) if isfinite(value) else "-"


def _details(table: HilTable) -> list[str]:
    total = table.delay.p50_ms
    known = [(name, hop.p50_ms) for name, hop in table.hops.items() if isfinite(hop.p50_ms)]
    hops = ", ".join(f"{name} {value:.3f} ms ({value / total:.0%})" for name, value in known) or "-"
    clock = "one clock" if not table.clock_uncertainty_ms else "two clocks, offset estimated"
    lines = [
        f"delay by hop (medians of {table.commands} commands, {clock}): {hops}",
        f"loop: {table.slave.get('loop_rate_hz', '-')} Hz, late by p50 {table.slave.get('lateness_p50_us', '-')} us, "
        f"p99 {table.slave.get('lateness_p99_us', '-')} us, max {table.slave.get('lateness_max_us', '-')} us; "
        f"real time x{table.slave.get('real_time_factor', '-')}",
        f"wire: {_wire(table.slave)}",
        f"bytecode compiled before the start: {'yes' if table.bytecode_compiled else 'NO (python -m compileall)'}; "
        f"slave: {table.slave.get('board', '-')}, Python {table.slave.get('python', '-')}",
    ]
    if "labels" in table.slave:
        lines.append(f"label: {table.slave['labels']}")
    return lines + [f"note: {note}" for note in table.notes] + [f"WARNING: {text}" for text in table.warnings]


def _wire(slave: dict[str, str]) -> str:
    if "link_bytes_out" not in slave or slave.get("link_wire") != "pty":
        return slave.get("link_port", "-")
    frame = int(slave["link_bytes_out"]) / max(int(slave["link_messages_out"]), 1)
    added = frame * 10 / int(slave["link_baud"]) * 1e3
    return (
        f"{slave['link_port']}, a pseudo terminal, which carries a frame of {frame:.0f} bytes at once; "
        f"a UART at {slave['link_baud']} baud would add {added:.1f} ms"
    )


def to_json(table: HilTable, outcome: Outcome) -> dict[str, Any]:
    """The table and the mission's outcome as plain values; nan becomes null."""
    values = table._asdict()
    values["delay"] = table.delay._asdict()
    values["hops"] = {name: hop._asdict() for name, hop in table.hops.items()}
    paper = {
        "master_cpu": PAPER_MASTER_CPU,
        "startup_s": PAPER_STARTUP_S,
        "slave_memory": PAPER_MEMORY,
        "command_delay_s": PAPER_DELAY_S,
    }
    plain: dict[str, Any] = _without_nan({"table": values, "paper": paper, "outcome": outcome._asdict()})
    return plain


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [_without_nan(item) for item in value]
    finite = not isinstance(value, float) or value - value == 0.0
    return value if finite else None


def _pair(values: tuple[float, float], form: str) -> str:
    return ", ".join(form.format(value) for value in values)


def _times(theirs: float, ours: float) -> str:
    return f"{theirs / ours:,.0f} x" if ours > 0 else "-"
