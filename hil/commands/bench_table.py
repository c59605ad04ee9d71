"""`uuv-hil bench table`: the source paper's HIL table for this machine, or for boards on the network."""

import os
from typing import Any

from boards import Budgets, load_board
from boards.health import recognise
from boards.tree import Tree
from hil.bench import board_table
from hil.bench.board_table import Column
from hil.bench.harness import Bench
from hil.bench.record import Figure, Record, load, new_record, write_text
from hil.bench.table_run import Run, figures, fly
from hil.commands.bench_options import add_json, add_limits, add_scenario, changes_of, keep, limits_of, show
from hil.commands.parser import new_parser
from hil.errors import ConfigError
from hil.schema import preset_names

EXAMPLES = """\
Each repetition flies the scenario for --seconds with a master process of its own, and without --slave with a slave
process of its own, started once the master dials. One start before them warms the caches and is not counted. What
each figure is exactly: docs/benchmark.md.

A slave elsewhere is not started again: its start-up is only measured when it is started while this waits for it.

examples:
  uuv-hil bench table                                  this machine, beside the paper's boards
  uuv-hil bench table --check                          exit code 1 when a budget of the board is missed
  uuv-hil bench table --cpu-quota 25% --memory 512M --cpus 0      a laptop as a small board
  uuv-hil bench table --slave tcp/192.168.3.116:7447 --slave tcp/192.168.3.117:7447 --markdown boards.md
  uuv-hil bench table --json today.json --against yesterday.json --png table.png
"""
BUDGET_MISSED = 1
HERE = "this machine"


def main(arguments: list[str]) -> int:
    """Measure and print; 0, or 1 with --check when a budget is missed. Raises HilError."""
    options = _parser().parse_args(arguments)
    if options.repeat < 1 or not 1.0 <= options.seconds <= 86_400.0:
        raise ConfigError("command line: --repeat is at least 1, --seconds from 1 to 86400")
    earlier = [column for path in options.against for column in _earlier(path)]
    if options.slave and (options.cpus or options.cpu_quota or options.memory):
        raise ConfigError("command line: --cpus, --cpu-quota and --memory limit a slave started here, not --slave")
    record, slaves = _measure(options)
    ours = board_table.columns_of(record)
    columns = [*board_table.paper(), *earlier, *(_named(column) for column in ours)]
    _write(columns, options)
    keep(record, options)
    print(board_table.text(columns))
    for line in (
        f"medians of {options.repeat} runs of {options.seconds:g} s; (range of the middle half)",
        *_said(record),
    ):
        print(line)
    if not options.check:
        return 0
    broken = [text for column in ours for text in _missed(column, slaves[column.title], options.board)]
    for text in broken:
        print(f"BUDGET MISSED: {text}")
    if not broken:
        print("every budget is kept")
    return BUDGET_MISSED if broken else 0


def _parser() -> Any:
    parser = new_parser("bench table", __doc__, EXAMPLES)
    add_scenario(parser)
    add = parser.add_argument
    add(
        "--slave", action="append", default=[], metavar="ENDPOINT", help="a slave elsewhere; may be given several times"
    )
    add("--repeat", type=int, default=5, metavar="N", help="repetitions [%(default)s]")
    add("--seconds", type=float, default=10.0, metavar="S", help="of flight in each [%(default)s]")
    add("--against", action="append", default=[], metavar="FILE", help="an earlier --json beside it")
    add("--check", action="store_true", help="against the budgets of the board")
    add("--board", metavar="NAME", help="whose budgets [recognised]")
    add_limits(parser)
    add_json(parser)
    add("--csv", metavar="FILE", help="the table as CSV")
    add("--markdown", metavar="FILE", help="the table as Markdown")
    add("--png", metavar="FILE", help="the table as a picture")
    return parser


def _measure(options: Any) -> tuple[Record, dict[str, dict[str, str]]]:
    """The record, and what each slave said of itself last."""
    changes = {"recording.master": False, **changes_of(options), "master.time_limit": options.seconds}
    found: dict[str, Figure] = {}
    slaves: dict[str, dict[str, str]] = {}
    details: dict[str, Any] = {}
    labels: tuple[str, ...] = ()
    for endpoint in options.slave or [""]:
        with Bench(options.scenario, changes, limits_of(options)) as bench:
            runs = _repeat(bench, options.repeat, endpoint)
            labels = bench.labels
        found |= {f"{name} @ {endpoint}" if endpoint else name: figure for name, figure in figures(runs).items()}
        slaves[endpoint] = runs[-1].slave
        details[endpoint or HERE] = {"slave": runs[-1].slave, "notes": sorted({n for run in runs for n in run.notes})}
    settings = {key: getattr(options, key) for key in ("scenario", "set", "slave", "repeat", "seconds")}
    return new_record("table", settings, found, labels, details), slaves


def _repeat(bench: Bench, times: int, endpoint: str) -> list[Run]:
    if not endpoint:
        show("warming the caches")
        warm = bench.start_slave()
        with bench.client() as client:
            client.wait_for_vehicle(60.0)
        warm.stop()
    runs = []
    for number in range(times):
        show(f"{endpoint or HERE}: run {number + 1} of {times}")
        runs.append(fly(bench, number, endpoint))
    show("")
    return runs


def _earlier(path: str) -> list[Column]:
    record = load(path)
    if record.kind != "table":
        raise ConfigError(f"{path}: is a result of `uuv-hil bench {record.kind}`, not of `bench table`")
    name = os.path.basename(path).removesuffix(".json")
    return [*board_table.columns_of(record, name)]


def _named(column: Column) -> Column:
    return column._replace(title=column.title or HERE)


def _write(columns: list[Column], options: Any) -> None:
    if options.csv:
        write_text(options.csv, board_table.comma_separated(columns))
    if options.markdown:
        write_text(options.markdown, board_table.markdown(columns) + "\n")
    if options.png:
        board_table.draw(columns, options.png)


def _said(record: Record) -> list[str]:
    machine = record.machine
    lines = [
        f"master here: {machine['cpu']}, {machine['cores']} cores, {machine['kernel']}, Python {machine['python']}, "
        f"load {machine['load']:.1f}",
        *(f"label: {label}" for label in record.labels),
    ]
    for name, detail in record.details.items():
        slave = detail["slave"]
        compiled = "" if slave.get("bytecode_compiled") == "true" else ", bytecode NOT compiled before the start"
        lines.append(
            f"slave {name}: {slave.get('board', '-')}, Python {slave.get('python', '-')}, "
            f"{slave.get('loop_rate_hz', '-')} Hz, link {slave.get('link_port', '-')}{compiled}"
        )
        lines += [f"note: {note}" for note in detail["notes"]]
    return lines


def _missed(column: Column, slave: dict[str, str], board: str | None) -> list[str]:
    name, budgets = _budgets(column.title, slave, board)
    return [f"{name}: {text}" for text in board_table.missed(column, budgets)]


def _budgets(endpoint: str, slave: dict[str, str], wish: str | None) -> tuple[str, Budgets]:
    """Of the board wished for, of the one that a slave elsewhere says it is, or of this machine."""
    found = load_board(wish) if wish else None
    if found is None and endpoint:
        boards = map(load_board, preset_names("boards"))
        found = next((board for board in boards if board.name == slave.get("board")), None)
    elif found is None:
        found = recognise(Tree())
    if found is None:
        raise ConfigError(f"no budgets for {slave.get('board') or 'this machine'}; name a board with --board")
    return found.name, found.budgets
