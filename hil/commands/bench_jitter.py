"""`uuv-hil bench jitter`: how late the loop wakes up, beside what the kernel and the bare interpreter do."""

import os
from typing import Any

from hil.bench.jitter_run import Cycles, Lateness, bare_loop, cyclictest, slave_loop
from hil.bench.limits import Limits
from hil.bench.record import Figure, new_record
from hil.columns import aligned
from hil.commands.bench_options import add_json, add_limits, add_scenario, changes_of, keep, limits_of, show
from hil.commands.parser import new_parser
from hil.errors import ConfigError

EXAMPLES = """\
For each rate, one after the other on the same processor: cyclictest (rt-tests, where it is installed: what the kernel
can do), a loop in Python that does nothing, and the slave with a master that commands it 20 times a second. Lateness
counts every cycle: of a wake-up that comes three periods late, three. Since the start, its own included.

examples:
  uuv-hil bench jitter                                     250 Hz, 400 Hz and 1 kHz, pinned to the last processor
  uuv-hil bench jitter --rates 400 --seconds 60 --json jitter.json
  uuv-hil bench jitter --cpus 0 --check                    exit code 1 when less than 99 % of cycles are within 2 ms
"""
WITHIN = 0.99
MISSED = 1


def main(arguments: list[str]) -> int:
    """Measure and print; 0, or 1 with --check when cycles are missed. Raises HilError."""
    parser = new_parser("bench jitter", __doc__, EXAMPLES)
    add_scenario(parser)
    parser.add_argument("--rates", default="250,400,1000", metavar="LIST", help="in Hz [%(default)s]")
    parser.add_argument("--seconds", type=float, default=20.0, metavar="S", help="for each [%(default)s]")
    parser.add_argument("--check", action="store_true", help="whether 99 %% of the cycles are within 2 ms")
    add_limits(parser)
    add_json(parser)
    options = parser.parse_args(arguments)
    rates = _rates(options.rates)
    if not 1.0 <= options.seconds <= 86_400.0:
        raise ConfigError("command line: --seconds is from 1 to 86400")
    limits = limits_of(options)
    limits = limits if limits.cpus else limits._replace(cpus=(_last_cpu(),))
    rows: list[list[str]] = [["", "late p50 us", "p99", "p99.9", "max", "within 2 ms", "skipped", "behind"]]
    figures: dict[str, Figure] = {}
    kept = True
    for rate in rates:
        kept &= _measure(rate, options, limits, rows, figures)
    show("")
    record = new_record("jitter", {"rates": rates, "seconds": options.seconds}, figures, (limits.label,))
    print("\n".join(aligned(rows, rule=True)))
    print(f"pinned to processor {','.join(map(str, limits.cpus))}; behind: cycles that the schedule lacks at the end")
    keep(record, options)
    if options.check and not kept:
        print(f"MISSED: less than {WITHIN:.0%} of the cycles were within 2 ms")
    return MISSED if options.check and not kept else 0


def _measure(rate: float, options: Any, limits: Limits, rows: list[list[str]], figures: dict[str, Figure]) -> bool:
    """One rate's rows and figures; whether its slave kept to it."""
    cpu = limits.cpus[0]
    show(f"{rate:g} Hz: cyclictest")
    kernel = cyclictest(rate, options.seconds / 2, cpu)
    show(f"{rate:g} Hz: bare loop")
    bare = bare_loop(rate, options.seconds / 2, cpu)
    show(f"{rate:g} Hz: slave")
    slave = slave_loop(rate, options.seconds, options.scenario, limits, changes_of(options))
    name = f"{rate:g} Hz"
    mean = f"{kernel.mean:.0f} (mean)" if kernel else ""
    rows.append([f"{name}, cyclictest", *_cells(kernel), mean, "", ""] if kernel else
                [f"{name}, cyclictest not installed or not permitted", *[""] * 7])  # fmt: skip
    rows.append([f"{name}, bare loop", *_cells(bare), "", "", ""])
    rows.append(
        [f"{name}, slave", *_cells(slave.late), f"{slave.within:.3%}", str(slave.skipped), f"{slave.drift:.1f}"]
    )
    figures |= _figures(name, kernel, bare, slave)
    return slave.within >= WITHIN


def _cells(late: Lateness) -> list[str]:
    return [f"{value:.0f}" for value in late[:4]]


def _figures(name: str, kernel: Lateness | None, bare: Lateness, slave: Cycles) -> dict[str, Figure]:
    found = {
        f"{name} slave p50": Figure([slave.late.p50], "us"),
        f"{name} slave p99": Figure([slave.late.p99], "us"),
        f"{name} slave p99.9": Figure([slave.late.p999], "us"),
        f"{name} slave max": Figure([slave.late.maximum], "us"),
        f"{name} within 2 ms": Figure([100.0 * slave.within], "%", "higher"),
        f"{name} skipped": Figure([float(slave.skipped)], "cycles"),
        f"{name} bare p50": Figure([bare.p50], "us", ""),
    }
    if kernel:
        found[f"{name} cyclictest mean"] = Figure([kernel.mean], "us", "")
        found[f"{name} slave p50 over cyclictest mean"] = Figure([slave.late.p50 / kernel.mean], "ratio")
    return found


def _rates(text: str) -> list[float]:
    try:
        rates = [float(word) for word in text.split(",")]
    except ValueError:
        rates = []
    if not rates or not all(50.0 <= rate <= 5000.0 for rate in rates):
        raise ConfigError(f"--rates {text!r}: expected numbers from 50 to 5000, such as 250,400,1000")
    return rates


def _last_cpu() -> int:
    return max(os.sched_getaffinity(0))
