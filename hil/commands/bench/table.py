"""`uuv-hil bench table`: measure the reference platform's HIL table for this machine, or for boards on the network."""

import os
from typing import Any

from boards import Board, load_board
from boards.health import recognise
from boards.tree import Tree
from hil.bench.harness import Bench, await_vehicle, labels_of
from hil.bench.record import Figure, Record, load
from hil.bench.report import Column, draw, remarks, text
from hil.bench.table import boards as board_table
from hil.bench.table.boards import HERE
from hil.bench.table.hil_table import DRAWN, PAPER_NOTE, ROWS, paper
from hil.bench.table.run import Run, figures, fly
from hil.commands.bench.options import (
    PartialFailures,
    add_connect,
    add_repeat,
    add_seconds,
    bench_parser,
    benchmark,
    parse,
    save_record,
    show,
)
from hil.common.clock import boot_id
from hil.common.columns import fit_to_terminal, paragraph
from hil.common.errors import ConfigError
from hil.common.options import add_board, changes_of
from hil.common.schema import preset_names
from hil.ros.diagnostics import Diagnostics, to_text

EXAMPLES = """\
Each repetition flies the scenario for --seconds with a master process of its own, and without --connect with a slave
process of its own, started once the master connects. One start before them warms the caches and is not counted. What
each figure is exactly: docs/explanation/benchmark.md.

A slave elsewhere is not started again: its start-up is only measured when it is started while this waits for it.

examples:
  uuv-hil bench table                                  this machine, beside the reference platform's boards
  uuv-hil bench table --check                          exit code 1 when a budget of the board is missed
  uuv-hil bench table --under "taskset -c 0"         a laptop as a small board
  uuv-hil bench table --connect tcp/192.168.3.116:7447 --connect tcp/192.168.3.117:7447
  uuv-hil bench table --output today.json --against yesterday.json --plot table.png
"""
BUDGET_MISSED = 1
SLAVE_KEYS = ("slave.", "stm32", "link.", "sensors.")  # keys of a scenario that its master does not use


@benchmark
def main(arguments: list[str]) -> int:
    """Measure and print; return 0, or 1 with --check when a budget is missed. Raises HilError.

    When a run fails or is stopped, the results of the runs before it are reported before the error is raised.
    """
    options = parse(_parser(), arguments)
    earlier = [column for path in options.against for column in _earlier(path)]
    if options.connect and options.under:
        raise ConfigError("command line: --under runs a slave started here, not one of --connect")
    inapplicable = [key for key in changes_of(options) if key.startswith(SLAVE_KEYS) and key != "slave.node"]
    if options.connect and inapplicable:
        raise ConfigError(
            f"command line: --set {inapplicable[0]}: it is not passed to a slave that runs elsewhere; set it there"
        )
    board = _board(options)
    failures = PartialFailures()
    record = _measure(options, failures)
    own_columns = board_table.columns_of(record)
    columns = [*paper(), *earlier, *own_columns]
    print(text(columns, ROWS))
    print(paragraph(PAPER_NOTE))
    for line in filter(None, (_ratios(column, record) for column in own_columns)):
        print(fit_to_terminal(line))
    runs = f"medians of {failures.most(options.repeat)} runs of {options.seconds:g} s"
    print(fit_to_terminal(f"{runs}; (range of the middle half)"))
    for line in (*remarks(earlier), *_description(record)):
        print(fit_to_terminal(line))
    if options.plot:
        draw(columns, [row for row in ROWS if row.name in DRAWN], options.plot)
    broken = _check(own_columns, record, board) if options.check else 0
    failures.raise_first()
    return broken


def _parser() -> Any:
    parser = bench_parser("table", __doc__, EXAMPLES)
    add = parser.add_argument
    add_connect(parser, action="append", default=[])
    add_repeat(parser, 5, "repetitions")
    add_seconds(parser, 10.0, "flight")
    add("--against", action="append", default=[], metavar="FILE", help="show an earlier record beside it")
    add("--check", action="store_true", help="check against the budgets of the board")
    add_board(parser)
    return parser


def _measure(options: Any, failures: PartialFailures) -> Record:
    """Return the record. An error that ended the runs of a slave early is raised if there is no run at all."""
    changes = {"recording.master": False, **changes_of(options), "master.time_limit": options.seconds}
    measured: dict[str, Figure] = {}
    details: dict[str, Any] = {}
    labels: list[str] = []
    for endpoint in options.connect or [""]:
        name = endpoint or HERE
        runs: list[Run] = []
        failures.begin(f"{name}: run 1 of {options.repeat}")
        with failures.caught(), Bench(options.scenario, changes, options.under) as bench:
            labels += bench.labels
            _repeat(bench, options.repeat, endpoint, runs, failures)
        if runs:
            labels += labels_of(runs[-1].slave) if endpoint else ()
            measured |= {f"{row} @ {endpoint}" if endpoint else row: figure for row, figure in figures(runs).items()}
            details[name] = {
                "slave": runs[-1].slave.raw,
                "notes": sorted({text for run in runs for text in run.notes}),
                "warnings": sorted({text for run in runs for text in run.warnings}),
            }
        if failures.stopped:
            break
    if not measured:
        failures.raise_first()
    return save_record("table", options, measured, dict.fromkeys((*labels, *failures.labels)), details)


def _repeat(bench: Bench, times: int, endpoint: str, runs: list[Run], failures: PartialFailures) -> None:
    """Append each run as it ends, so that a failure does not lose the runs before it. Raises HilError."""
    if not endpoint:
        show("warming the caches")
        warm = bench.start_slave()
        with bench.client() as client:
            await_vehicle(client, warm)
        warm.stop()
    for number in range(times):
        failures.begin(f"{endpoint or HERE}: run {number + 1} of {times}")
        runs.append(fly(bench, number, endpoint))


def _earlier(path: str) -> list[Column]:
    record = load(path)
    if record.kind != "table":
        raise ConfigError(f"{path}: is a result of `uuv-hil bench {record.kind}`, not of `bench table`")
    name = os.path.basename(path).removesuffix(".json")
    return board_table.columns_of(record, name)


def _ratios(column: Column, record: Record) -> str:
    """Return ratios to the reference platform, if that had the board that this slave reports."""
    return board_table.ratios(column, Diagnostics(record.details[column.title]["slave"]).board or "")


def _description(record: Record) -> list[str]:
    machine = record.machine
    lines = [
        f"master here: {machine['cpu']}, {machine['cores']} cores, {machine['kernel']}, Python {machine['python']}, "
        f"load {machine['load']:.1f}",
    ]
    for name, detail in record.details.items():
        slave = Diagnostics(detail["slave"])
        compiled = "" if slave.bytecode_compiled else ", bytecode NOT compiled before the start"
        lines.append(
            f"slave {name}: {to_text(slave.board)}, Python {to_text(slave.python)}, "
            f"{to_text(slave.loop_rate_hz, '.0f')} Hz, link {to_text(slave.link_port)}{compiled}"
        )
        lines += [f"note: {note}" for note in detail["notes"]]
        lines += [f"WARNING: (!) marks an unreliable figure: {text}" for text in detail["warnings"]]
    return lines


def _check(columns: list[Column], record: Record, board: Board | None) -> int:
    """Compare each column with its budgets, and print which are missed. Raises ConfigError if a slave has none."""
    broken = []
    for column in columns:
        own_board = board or _board_of(column.title, Diagnostics(record.details[column.title]["slave"]))
        broken += [f"{own_board.name}: {budget}" for budget in board_table.missed(column, own_board.budgets)]
    for budget in broken:
        print(fit_to_terminal(f"BUDGET MISSED: {budget}"))
    if not broken:
        print("every budget is met")
    return BUDGET_MISSED if broken else 0


def _board(options: Any) -> Board | None:
    """Return the board of --board, else this machine's for --check; None if slaves elsewhere report theirs.

    Raises ConfigError.
    """
    if options.board:
        return load_board(options.board)
    if options.connect or not options.check:
        return None
    board = recognise(Tree())
    if board is None:
        raise ConfigError(f"no budgets for this machine; {_remedy()}")
    return board


def _board_of(endpoint: str, slave: Diagnostics) -> Board:
    """Return the board that a slave reports, or this machine's where it runs here. Raises ConfigError."""
    name = slave.board or ""
    boards = map(load_board, preset_names("boards"))
    named = next((board for board in boards if board.name == name), None)
    if named is None and slave.boot_id == boot_id():
        named = recognise(Tree())
    if named is None:
        raise ConfigError(f"no budgets for {endpoint}, which says that its board is {name!r}; {_remedy()}")
    return named


def _remedy() -> str:
    return f"name a board with --board NAME: {', '.join(preset_names('boards'))}"
