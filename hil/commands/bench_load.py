"""`uuv-hil bench load`: CPU and memory over time, per process and thread, by sensors, rates and numbers of vehicles."""

import os
from typing import Any

from hil.bench.load_run import Course, Setting, middle, run, settings
from hil.bench.plotting import pyplot
from hil.bench.record import Figure, new_record
from hil.columns import aligned
from hil.commands.bench_options import add_json, add_limits, add_scenario, changes_of, keep, limits_of, show
from hil.commands.parser import new_parser
from hil.errors import ConfigError

EXAMPLES = """\
Slaves that are commanded 20 times a second, one setting after the other. CPU is that of all their processes, in shares
of one core; memory their proportional set size.

examples:
  uuv-hil bench load                                    the scenario as it is
  uuv-hil bench load --each-sensor --seconds 5          what each sensor costs
  uuv-hil bench load --rates 100,400,1000 --vehicles 1,2,4 --png load.png --json load.json
"""
MOST_VEHICLES = 64


def main(arguments: list[str]) -> int:
    """Measure and print; the exit code. Raises HilError."""
    parser = new_parser("bench load", __doc__, EXAMPLES)
    add_scenario(parser)
    add = parser.add_argument
    add("--each-sensor", action="store_true", help="also with each sensor more, and each one less")
    add("--rates", default="", metavar="LIST", help="also with the loop at these, Hz")
    add("--vehicles", default="", metavar="LIST", help="also with so many slaves at once")
    add("--seconds", type=float, default=10.0, metavar="S", help="for each [%(default)s]")
    add_limits(parser)
    add_json(parser)
    add("--png", metavar="FILE", help="CPU and memory over time")
    options = parser.parse_args(arguments)
    if not 2.0 <= options.seconds <= 86_400.0:
        raise ConfigError("command line: --seconds is from 2 to 86400")
    plan = [*settings(options.each_sensor, _rates(options.rates), _counts(options.vehicles))]
    courses, base = [], changes_of(options)
    for number, setting in enumerate(plan):
        courses.append(_run(setting._replace(changes=base | setting.changes), options, number, len(plan)))
    show("")
    print("\n".join(_table(courses)))
    print(f"\nthreads of {courses[-1].setting.name}: {_threads(courses[-1])}")
    figures = {f"{c.setting.name} cpu": Figure([100.0 * x for x in c.cpu], "% of a core") for c in courses}
    figures |= {f"{c.setting.name} memory": Figure(c.memory, "MiB") for c in courses}
    details = {course.setting.name: {"threads": course.threads} for course in courses}
    asked = {key: getattr(options, key) for key in ("scenario", "set", "rates", "vehicles", "seconds")}
    limits = limits_of(options)
    keep(new_record("load", asked, figures, (limits.label,) if limits.label else (), details), options)
    if options.png:
        _draw(courses, options.png)
    return 0


def _run(setting: Setting, options: Any, number: int, count: int) -> Course:
    def watch(share: float) -> None:
        show(f"{number + 1} of {count}: {setting.name} {share:4.0%}")

    watch(0.0)
    return run(setting, options.scenario, options.seconds, limits_of(options), watch)


def _table(courses: list[Course]) -> list[str]:
    rows = [["setting", "CPU % of a core", "more", "memory MiB", "more"]]
    cpu, memory = middle(courses[0])
    for course in courses:
        own_cpu, own_memory = middle(course)
        first = course is courses[0]
        more = ["", ""] if first else [f"{100.0 * (own_cpu - cpu):+.2f}", f"{own_memory - memory:+.2f}"]
        rows.append([course.setting.name, f"{100.0 * own_cpu:.2f}", more[0], f"{own_memory:.2f}", more[1]])
    return aligned(rows, rule=True)


def _threads(course: Course) -> str:
    shown = [(name, share) for name, share in course.threads.items() if share >= 0.0005]
    return ", ".join(f"{name} {share:.2%}" for name, share in shown)


def _draw(courses: list[Course], path: str) -> None:
    plt = pyplot()
    figure, (upper, lower) = plt.subplots(2, 1, figsize=(10, 8), layout="constrained", sharex=True)
    for course in courses:
        time = range(1, len(course.cpu) + 1)
        upper.plot(time, [100.0 * value for value in course.cpu], label=course.setting.name)
        lower.plot(time, course.memory, label=course.setting.name)
    upper.set(ylabel="CPU (% of a core)", ylim=(0, None))
    lower.set(ylabel="memory (MiB)", xlabel="time (s)", ylim=(0, None))
    upper.legend(fontsize="x-small", ncols=3)
    try:
        figure.savefig(path, dpi=110)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{os.path.abspath(path)}: cannot be written: {error}") from None
    finally:
        plt.close(figure)


def _rates(text: str) -> list[float]:
    rates = _numbers(text, "--rates")
    if not all(50.0 <= rate <= 5000.0 for rate in rates):
        raise ConfigError(f"--rates {text!r}: expected numbers from 50 to 5000, such as 100,400")
    return rates


def _counts(text: str) -> list[int]:
    counts = _numbers(text, "--vehicles")
    if not all(count == int(count) and 1 <= count <= MOST_VEHICLES for count in counts):
        raise ConfigError(f"--vehicles {text!r}: expected whole numbers from 1 to {MOST_VEHICLES}, such as 1,2,4")
    return [int(count) for count in counts]


def _numbers(text: str, option: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",") if word]
    except ValueError:
        raise ConfigError(f"{option} {text!r}: expected numbers with commas between") from None
