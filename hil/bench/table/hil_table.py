"""The HIL table: the reference platform's four figures for a run of ours, with their definitions.

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

from hil.client.client import VehicleClient
from hil.client.delay import HOPS, Quantiles, find_doubts, quantiles
from hil.common.clock import boot_id
from hil.common.columns import aligned
from hil.common.text import json_value
from hil.master.flight import Outcome
from hil.ros.diagnostics import Diagnostics, or_nan, to_text


class PaperBoard(NamedTuple):
    """A board of the reference platform: our profile of it, and its line in table 1. Shares are 0..1."""

    title: str
    profile: str
    master_cpu: float
    startup_s: float
    memory: float
    delay_s: float


# Zhang et al., "Design and Implementation of a Modular UUV Simulation Platform", Sensors 2022, 22(20), 8043, table 1.
PAPER_BOARDS = (
    PaperBoard("Jetson Nano", "jetson_nano", 0.42, 3.2, 0.37, 2.0),
    PaperBoard("Raspberry Pi 4B", "raspberry_pi_4b", 0.42, 3.6, 0.59, 1.9),
)
PAPER_WORLDS = ("paper_field", "paper_hunt")
PAPER_NOTE = (
    "2022: the boards of Zhang et al., table 1, over a wlan; only a run on such a board may be compared with them"
)
UART_BITS = 10  # a byte: start, eight, stop
# Wires whose baud is no part of a measured delay, by their name in `link_wire` of the diagnostics.
NO_SPEED = {"pty": "a pseudo terminal", "tcp": "a socket", "udp": "a socket"}
PAPER_BOARD_MIB = 4096.0  # the larger memory of its two boards, to compare a share with when ours is larger


class HilTable(NamedTuple):
    """The figures of one run. Shares are 0..1; nan where a figure is missing, with the reason in `notes`.

    `warnings` are reasons to doubt the delays and the start-up: a clock is wrong. `events` has a line for each event of
    the run, such as a collision.
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
    slave: Diagnostics
    events: tuple[str, ...] = ()


class CpuMark(NamedTuple):
    """The processor time a slave had taken (s) at an instant (s, our clock), and which slave: when it was executed."""

    cpu_s: float
    at_s: float
    exec_wall_ns: int | None


def mark_cpu(client: VehicleClient) -> CpuMark:
    """Return the processor time that the vehicle last reported."""
    stamped = client.latest["diagnostics"]
    health: Diagnostics = stamped.value
    return CpuMark(or_nan(health.cpu_s), stamped.received_ns / 1e9, health.exec_wall_ns)


def build(client: VehicleClient, outcome: Outcome, first_cpu: CpuMark) -> HilTable:
    """Return the table of a mission just flown; `first_cpu` is of its beginning."""
    health = client.diagnostics()
    notes: list[str] = []
    delays = client.delays
    delays.same_clock = health.boot_id == boot_id()
    offset_ns, uncertainty_ns = delays.offset_ns()
    if not delays.same_clock or offset_ns:
        clocks = "one machine whose clock was set between the two starts" if delays.same_clock else "two machines"
        notes.append(
            f"{clocks}: clock offset {offset_ns / 1e6:.3f} ms estimated from {len(delays)} exchanges, "
            f"known to +-{uncertainty_ns / 1e6:.3f} ms"
        )
    slave_core = _cpu_share(first_cpu, mark_cpu(client), notes)
    return HilTable(
        master_cpu_core=outcome.cpu_s / outcome.duration,
        master_cpu_machine=outcome.cpu_s / outcome.duration / (os.cpu_count() or 1),
        slave_cpu_core=slave_core,
        slave_cpu_machine=slave_core / or_nan(health.cores),
        startup_s=_startup_s(client, health, offset_ns, notes),
        slave_ready_s=or_nan(health.startup_ready_ms) / 1e3,
        slave_pss_mib=or_nan(health.pss_mib),
        slave_rss_mib=or_nan(health.rss_mib),
        slave_ram_mib=or_nan(health.ram_mib),
        delay=quantiles(delays.totals_ns()),
        hops={name: quantiles(delays.hop_ns(index)) for index, name in enumerate(HOPS)},
        commands=len(delays),
        clock_offset_ms=offset_ns / 1e6,
        clock_uncertainty_ms=uncertainty_ns / 1e6,
        bytecode_compiled=health.bytecode_compiled is True,
        notes=tuple(notes),
        warnings=tuple(find_doubts(delays)),
        slave=health,
        events=tuple(outcome.event_lines),
    )


def _cpu_share(first: CpuMark, last: CpuMark, notes: list[str]) -> float:
    """Return the slave's processor time over the time between, in cores; nan if they are not of one process."""
    if first.exec_wall_ns != last.exec_wall_ns:
        notes.append("slave CPU not measured: the slave was restarted during the run")
        return float("nan")
    return (last.cpu_s - first.cpu_s) / max(last.at_s - first.at_s, 1e-9)


def _startup_s(client: VehicleClient, health: Diagnostics, offset_ns: int, notes: list[str]) -> float:
    exec_wall_ns = health.exec_wall_ns or 0
    if client.opened_wall_ns > exec_wall_ns - offset_ns:
        notes.append("start-up not measured: the slave was running before this master (start the master first)")
        return float("nan")
    first_ns = client.first_sample_ns(exec_wall_ns)
    if first_ns is None:
        notes.append("start-up not measured: no sample of this slave came")
        return float("nan")
    return (first_ns - exec_wall_ns + offset_ns) / 1e9


def render(table: HilTable, world: str) -> str:
    """Return the table as text for a terminal, beside the paper's where the `world` is one of its fields."""
    boards = PAPER_BOARDS if world in PAPER_WORLDS else ()
    ram = min(table.slave_ram_mib, PAPER_BOARD_MIB)
    memory = table.slave_rss_mib / ram  # alone on a machine it shares memory with no other slave
    delay = table.delay
    rows = [
        ("", *(f"{board.title}, 2022" for board in boards), "this run"),
        (
            "master CPU",
            *(f"{board.master_cpu:.0%}" for board in boards),
            f"{table.master_cpu_core:.1%} of a core, {table.master_cpu_machine:.1%} of the machine",
        ),
        (
            "start-up",
            *(f"{board.startup_s:.1f} s" for board in boards),
            f"{_format(table.startup_s, '{:.3f} s')} to the first sample ({table.slave_ready_s:.3f} s to ready)",
        ),
        (
            "slave memory",
            *(f"{board.memory:.0%}" for board in boards),
            f"{table.slave_rss_mib:.1f} MiB, {memory:.2%} of {ram / 1024:.0f} GiB ({table.slave_pss_mib:.1f} MiB PSS)",
        ),
        (
            "command delay",
            *(f"{board.delay_s:.1f} s" for board in boards),
            f"p50 {_format(delay.p50_ms)}, p99 {_format(delay.p99_ms)}, max {_format(delay.max_ms, '{:.1f} ms')}",
        ),
        ("slave CPU", *("-" for _ in boards), _share(table)),
    ]
    note = [PAPER_NOTE, ""] if boards else []
    return "\n".join([*aligned(rows, rule=True), "", *note, *_details(table)])


def _share(table: HilTable) -> str:
    if not isfinite(table.slave_cpu_core):
        return "-"
    return f"{table.slave_cpu_core:.1%} of a core, {table.slave_cpu_machine:.1%} of the machine"


def _format(value: float, form: str = "{:.2f} ms") -> str:
    return form.format(value) if isfinite(value) else "-"


def _details(table: HilTable) -> list[str]:
    total, slave = table.delay.p50_ms, table.slave
    known = [(name, hop.p50_ms) for name, hop in table.hops.items() if isfinite(hop.p50_ms)]
    hops = ", ".join(f"{name} {value:.3f} ms ({value / total:.0%})" for name, value in known) or "-"
    clock = "one clock" if not table.clock_uncertainty_ms else "two clocks, offset estimated"
    lines = [
        f"delay by hop (medians of {table.commands} commands, {clock}): {hops}",
        f"loop: {to_text(slave.loop_rate_hz, '.0f')} Hz, late by p50 {to_text(slave.lateness_p50_us, '.0f')} us, "
        f"p99 {to_text(slave.lateness_p99_us, '.0f')} us, max {to_text(slave.lateness_max_us, '.0f')} us; "
        f"real time x{to_text(slave.real_time_factor, '.4f')}",
        f"wire: {_wire(slave)}",
        f"bytecode compiled before the start: {'yes' if table.bytecode_compiled else 'NO (python -m compileall)'}; "
        f"slave: {to_text(slave.board)}, Python {to_text(slave.python)}",
    ]
    if slave.labels:
        lines.append(f"label: {'; '.join(slave.labels)}")
    lines += table.events
    return lines + [f"note: {note}" for note in table.notes] + [f"WARNING: {text}" for text in table.warnings]


def _wire(slave: Diagnostics) -> str:
    """Return the link, and where its wire has no speed, what a UART would add to each delay."""
    port = to_text(slave.link_port)
    name, frames, baud = NO_SPEED.get(slave.link_wire or ""), slave.link_messages_out, slave.link_baud
    if name is None or slave.link_held_baud or not frames or not baud or slave.link_bytes_out is None:
        return port
    frame = slave.link_bytes_out / frames
    return (
        f"{port}, {name}, which carries a frame of {frame:.0f} bytes at once; "
        f"a UART at {baud} baud would add {frame * UART_BITS / baud * 1e3:.1f} ms"
    )


def to_json(table: HilTable, outcome: Outcome) -> dict[str, Any]:
    """Return the table and the mission's outcome as plain values; nan becomes null."""
    values = table._asdict()
    values["slave"] = table.slave.raw
    values["delay"] = table.delay._asdict()
    values["hops"] = {name: hop._asdict() for name, hop in table.hops.items()}
    paper = {
        board.title: {
            "master_cpu": board.master_cpu,
            "startup_s": board.startup_s,
            "slave_memory": board.memory,
            "command_delay_s": board.delay_s,
        }
        for board in PAPER_BOARDS
    }
    plain: dict[str, Any] = json_value({"table": values, "paper": paper, "outcome": outcome.as_plain()})
    return plain
