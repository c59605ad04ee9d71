"""The HIL table: the reference platform's four figures for a run of ours, with their definitions.

master CPU     processor time of the master process from its first command to its last, over that time,
               as a share of one core
start-up       from the exec of the slave until the master has its first sensor sample
slave memory   proportional set size of all processes of the slave at the end of the run, and its share
               of the memory of the machine it runs on
command delay  from the master's publish until the STM32 end has applied the pulse widths
"""

from math import isfinite
from typing import Any, NamedTuple

from hil.bench.record import Figure
from hil.bench.report import Column, Row, text
from hil.client.client import VehicleClient
from hil.client.delay import HOPS, Quantiles, find_doubts, quantiles
from hil.common.clock import boot_id
from hil.common.text import json_value
from hil.master.flight import Outcome
from hil.ros.diagnostics import Diagnostics, or_nan, to_text


class PaperBoard(NamedTuple):
    """A board of the reference platform: our profile of it, and its line in table 1, as figures of our table.

    Master CPU in % of a core, start-up in s, share of the memory in %, delay in ms.
    """

    title: str
    profile: str
    master_cpu: float
    startup: float
    memory_share: float
    delay_p50: float


# Zhang et al., "Design and Implementation of a Modular UUV Simulation Platform", Sensors 2022, 22(20), 8043, table 1.
PAPER_BOARDS = (
    PaperBoard("Jetson Nano", "jetson_nano", 42.0, 3.2, 37.0, 2000.0),
    PaperBoard("Raspberry Pi 4B", "raspberry_pi_4b", 42.0, 3.6, 59.0, 1900.0),
)
DRAWN = PaperBoard._fields[2:]  # the figures that the paper has too
PAPER_WORLDS = ("paper_field", "paper_hunt")
PAPER_NOTE = (
    "2022: the boards of Zhang et al., table 1, over a wlan; only a run on such a board may be compared with them"
)
UART_BITS = 10  # a byte: start, eight, stop
# Wires whose baud is no part of a measured delay, by their name in `link_wire` of the diagnostics.
NO_SPEED = {"pty": "a pseudo terminal", "tcp": "a socket", "udp": "a socket"}
PAPER_BOARD_MIB = 4096.0  # the larger memory of its two boards, to compare a share with when ours is larger


ROWS = (
    Row("master_cpu", "master CPU", "% of a core", "{:.2f}"),
    Row("startup", "start-up to the first sample", "s", "{:.3f}", is_clocked=True),
    Row("ready", "start-up to ready", "s", "{:.3f}"),
    Row("memory", "slave memory", "MiB", "{:.1f}"),
    Row("memory_alone", "slave memory, alone on its machine", "MiB", "{:.1f}"),
    Row("memory_share", "slave memory, share of the board's", "%", "{:.2f}"),
    Row("delay_p50", "command delay p50", "ms", "{:.2f}", is_clocked=True),
    Row("delay_p99", "command delay p99", "ms", "{:.2f}", is_clocked=True),
    Row("delay_max", "command delay max", "ms", "{:.2f}", is_clocked=True),
    Row("slave_cpu", "slave CPU", "% of a core", "{:.2f}"),
    Row("slave_cpu_floor", "waking and publishing alone", "% of a core", "{:.2f}", better=""),
)


class HilTable(NamedTuple):
    """The figures of one run. Shares are 0..1; nan where a figure is missing, with the reason in `notes`.

    `warnings` are reasons to doubt the delays and the start-up: a clock is wrong. `events` has a line for each event of
    the run, such as a collision.
    """

    master_cpu_core: float
    slave_cpu_core: float
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
        slave_cpu_core=slave_core,
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


def paper() -> list[Column]:
    """Return the reference platform's two boards; it gives one number each, without spread."""
    return [
        Column(
            f"{board.title}, 2022",
            {row.name: Figure([getattr(board, row.name)], row.unit) for row in ROWS if row.name in DRAWN},
        )
        for board in PAPER_BOARDS
    ]


def row_values(table: HilTable) -> dict[str, float]:
    """Return the value of each of `ROWS` that a master measures."""
    ram = min(table.slave_ram_mib, PAPER_BOARD_MIB)
    return {
        "master_cpu": 100.0 * table.master_cpu_core,
        "startup": table.startup_s,
        "ready": table.slave_ready_s,
        "memory": table.slave_pss_mib,
        "memory_alone": table.slave_rss_mib,  # alone on a machine it shares memory with no other slave
        "memory_share": 100.0 * table.slave_rss_mib / ram,
        "delay_p50": table.delay.p50_ms,
        "delay_p99": table.delay.p99_ms,
        "delay_max": table.delay.max_ms,
        "slave_cpu": 100.0 * table.slave_cpu_core,
    }


def render(table: HilTable, world: str) -> str:
    """Return the table as text for a terminal, beside the paper's where the `world` is one of its fields."""
    values = row_values(table)
    rows = [row for row in ROWS if row.name in values]
    ours = Column("this run", {row.name: Figure([values[row.name]], row.unit).finite for row in rows})
    columns = [*(paper() if world in PAPER_WORLDS else []), ours]
    note = [PAPER_NOTE, ""] if len(columns) > 1 else []
    return "\n".join([text(columns, rows), "", *note, *_details(table)])


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
    return lines + [f"note: {note}" for note in table.notes] + [f"WARNING: {warning}" for warning in table.warnings]


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
    values = table._asdict() | {"rows": row_values(table)}
    values["slave"] = table.slave.raw
    values["delay"] = table.delay._asdict()
    values["hops"] = {name: hop._asdict() for name, hop in table.hops.items()}
    plain: dict[str, Any] = json_value({"table": values, "outcome": outcome.as_plain()})
    return plain
