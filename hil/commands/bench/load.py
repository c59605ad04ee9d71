"""`uuv-hil bench load`: measure CPU and memory over time, per process, by sensors, rates and vehicles."""

from typing import Any

from hil.bench import load_run
from hil.bench.load_run import Course, Setting, difference, settings
from hil.bench.presence import simulation_of
from hil.bench.record import Figure, median, spread
from hil.bench.report import Column, Row
from hil.commands.bench.options import PartialFailures, add_seconds, bench_parser, benchmark, parse, save_columns, show
from hil.common.columns import aligned, fit_to_terminal
from hil.common.errors import HilError, NetworkError
from hil.common.options import List, Number, changes_of, integer
from hil.scenario.config import load_scenario

EXAMPLES = """\
It measures slaves that get 20 commands a second, one setting after the other. CPU is in shares of one core, memory is
the proportional set size. "+-" is the range of the middle half of the values, one value a second. "more" is the
difference from the unchanged scenario, in brackets where it is within the noise. Sensors that the vehicle or the world
cannot have are left out and named. Exit code 1 when a setting could not be measured.

examples:
  uuv-hil bench load                                    the scenario unchanged
  uuv-hil bench load --each-sensor --seconds 5          what each sensor costs
  uuv-hil bench load --rates 100,400,1000 --vehicles 1,2,4 --plot load.png --output load.json
"""
MAX_VEHICLES = 64
RATES = List(Number(50.0, 5000.0, "Hz"))
VEHICLES = List(integer(1, MAX_VEHICLES))
FAILED = 1
ROWS = (Row("cpu", "CPU", "% of a core", "{:.2f}"), Row("memory", "memory", "MiB", "{:.2f}"))


@benchmark
def main(arguments: list[str]) -> int:
    """Measure and print; return 0, or 1 when a setting could not be measured. Raises HilError."""
    options = parse(_parser(), arguments)
    plan = _plan(options)
    courses: list[Course] = []
    left_out: dict[str, str] = {}
    failures = PartialFailures()
    with failures.caught():
        for number, setting in enumerate(plan, 1):
            progress = f"{number} of {len(plan)}: {setting.name}"
            failures.begin(progress)
            try:
                simulation_of(load_scenario(options.scenario, setting.changes))
            except HilError as error:
                if number == 1:
                    raise
                left_out[setting.name] = str(error)  # this vehicle, world or machine cannot have it
            else:
                courses.append(_run(setting, options, progress))
    measured, failed = [c for c in courses if c.cpu], [c for c in courses if c.failure]
    if not measured:
        failures.raise_first()
        raise NetworkError(f"nothing could be measured: {failed[0].failure}")
    print("\n".join(_table(courses)))
    note = "more: difference from the unchanged scenario, in brackets if within the noise; +-: middle half's range\n"
    print(fit_to_terminal(note))
    for name, reason in left_out.items():
        print(f"left out: {name}: {reason}")
    for each in failed:
        print(f"FAILED: {each.setting.name}: {each.failure}")
    _save(measured, failed, left_out, options, failures)
    failures.raise_first()
    return FAILED if failed else 0


def _parser() -> Any:
    parser = bench_parser("load", __doc__, EXAMPLES)
    add = parser.add_argument
    add("--each-sensor", action="store_true", help="also with each sensor added, and with each one removed")
    add("--rates", default=(), metavar="LIST", type=RATES, help="also with these rates of the loop, Hz")
    add("--vehicles", default=(), metavar="LIST", type=VEHICLES, help="also with these numbers of slaves at once")
    add_seconds(parser, 10.0, "run", least=2.0)
    return parser


def _plan(options: Any) -> list[Setting]:
    """Return the settings to measure."""
    base = changes_of(options)
    fitted = [*load_scenario(options.scenario, base).sensors] if options.each_sensor else None
    wanted = settings(fitted, [*options.rates], [*options.vehicles])
    return [setting._replace(changes=base | setting.changes) for setting in wanted]


def _run(setting: Setting, options: Any, progress: str) -> Course:
    """Run one setting and return its result. A failure is a result too, so that the others still run."""

    def watch(share: float) -> None:
        show(f"{progress} {share:4.0%}")

    try:
        return load_run.run(setting, options.scenario, options.seconds, options.under, watch)
    except HilError as error:
        return Course(setting, failure=str(error))


def _table(courses: list[Course]) -> list[str]:
    rows = [["setting", "CPU % of a core", "+-", "more", "memory MiB", "+-", "more"]]
    base = courses[0]
    repeats = [c for c in courses[1:] if c.cpu and c.setting[1:] == base.setting[1:]]
    for course in courses:
        if not course.cpu:
            rows.append([course.setting.name, "failed", *[""] * 5])
            continue
        cpu = _cells(course.cpu, base.cpu, [c.cpu for c in repeats], 100.0)
        memory = _cells(course.memory, base.memory, [c.memory for c in repeats])
        if course is base or not base.cpu:
            cpu[-1] = memory[-1] = ""
        rows.append([course.setting.name, *cpu, *memory])
        for name, cost in course.processes.items() if len(course.processes) > 1 else ():
            own = f"{100.0 * median(cost.cpu):.2f}", f"{100.0 * spread(cost.cpu):.2f}", ""
            rows.append([f"- {name}", *own, f"{median(cost.memory):.2f}", f"{spread(cost.memory):.2f}", ""])
    return aligned(rows, rule=True)


def _cells(values: list[float], base: list[float], repeats: list[list[float]], factor: float = 1.0) -> list[str]:
    """Return median, spread, and the difference from `base`."""
    change, is_distinct = difference(values, base, repeats)
    more = f"{factor * change:+.2f}"
    return [f"{factor * median(values):.2f}", f"{factor * spread(values):.2f}", more if is_distinct else f"({more})"]


def _save(
    measured: list[Course], failed: list[Course], left_out: dict[str, str], options: Any, failures: PartialFailures
) -> None:
    columns = []
    for course in measured:
        series = {"": (course.cpu, course.memory)}
        if len(course.processes) > 1:
            series |= {f"{name} ": (cost.cpu, cost.memory) for name, cost in course.processes.items()}
        figures: dict[str, Figure] = {}
        for name, (cpu, memory) in series.items():
            figures[f"{name}cpu"] = Figure([100.0 * x for x in cpu], "% of a core")
            figures[f"{name}memory"] = Figure(memory, "MiB")
        columns.append(Column(course.setting.name, figures))
    details: dict[str, Any] = {course.setting.name: {"failure": course.failure} for course in failed}
    labels = *measured[0].labels, *failures.labels
    save_columns("load", options, columns, ROWS, labels, details | {"left out": left_out})
