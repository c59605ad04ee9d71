"""`uuv-hil bench delay`: measure the delay of commands, hop by hop, beside the floor of the machine."""

import itertools
from argparse import ArgumentTypeError
from typing import Any, NamedTuple

from hil.bench import delay_report
from hil.bench.delay_run import Echo, Plan, Result, measure, pooled
from hil.bench.harness import Bench
from hil.bench.record import Figure
from hil.bench.report import Column
from hil.commands.bench.options import (
    PartialFailures,
    add_connect,
    add_repeat,
    add_seconds,
    bench_parser,
    benchmark,
    parse,
    save_columns,
)
from hil.common.errors import ConfigError
from hil.common.options import List, Number, changes_of, host, integer, one_of
from hil.common.schema import shortened
from hil.slave.drivers.driver import DRIVERS

EXAMPLES = """\
Options that take LIST measure every combination: --baud 0,115200 --load 0,2 are four configurations. A baud paces
the link as a UART of that speed would; 0 does not limit it. The floor is bare UDP and TCP between the same machines
in the same seconds, and the frame's time on its line.

For a slave elsewhere, start `uuv-hil bench echo` beside it and name its ports. There is no floor without it.

To compare two versions of a program, --repeat 5: two starts of one program differ too.

examples:
  uuv-hil bench delay
  uuv-hil bench delay --stm32 python,process,native,unicorn --baud 0,115200 --plot delay.png
  uuv-hil bench delay --protocol vesc,dronecan --load 0,2
  uuv-hil bench delay --rate 10,50,100 --seconds 30 --output delay.json
  uuv-hil bench delay --connect tcp/192.168.3.116:7447 --echo 192.168.3.116:40001:40002
"""
ECHO_PORT = integer(1, 65_535)
STEPS = integer(0, 1000)
PROTOCOLS = List(one_of("frame", "mavlink", "dronecan", "vesc"))
STM32S = List(one_of(*DRIVERS))
BAUDS = List(integer(1200, 12_000_000, also=(0,)))
RATES = List(Number(1.0, 1000.0, "Hz"))
LOADS = List(integer(0, 1024))
MASTER_KEYS = ("network.", "security.", "slave.node")  # keys of a scenario that the master here uses
ON_CAN = {"dronecan": "can:virtual:bench", "vesc": "can:virtual:bench"}  # default ports


class Case(NamedTuple):
    """One configuration."""

    protocol: str
    stm32: str
    baud: int
    rate: float
    load: int

    def name(self, changing: list[str]) -> str:
        """Return a name from the values of the fields in `changing`."""
        values = {key: getattr(self, key) for key in changing}
        words = [f"{key} {value:g}" if isinstance(value, float) else f"{key} {value}" for key, value in values.items()]
        return ", ".join(words) or "as the scenario has it"


@benchmark
def main(arguments: list[str]) -> int:
    """Measure and print; return the exit code. Raises HilError."""
    options = parse(_parser(), arguments)
    cases = _cases(options)
    given = {key: getattr(options, key) for key in Case._fields if getattr(options, key) is not None}
    changing = [key for key, values in given.items() if len(values) > 1] or list(given)
    runs: dict[str, list[Result]] = {}
    labels: tuple[str, ...] = ()
    failures = PartialFailures()
    with failures.caught():
        for number, (_, case) in enumerate(itertools.product(range(options.repeat), cases), 1):
            name = case.name(changing)
            failures.begin(f"{number} of {options.repeat * len(cases)}: {name}")
            result, labels = _measure(case, options)
            runs.setdefault(name, []).append(result)
    if not runs:
        failures.raise_first()
    _report(runs, (*labels, *failures.labels), options)
    failures.raise_first()
    return 0


def _report(runs: dict[str, list[Result]], labels: tuple[str, ...], options: Any) -> None:
    """Print, save and draw the results. Raises ConfigError."""
    results = {name: pooled(repeats) for name, repeats in runs.items()}
    print(delay_report.text(results))
    columns = [Column(name, _figures(result)) for name, result in results.items()]
    details = {
        name: {"warnings": results[name].warnings, "runs": [_details(result) for result in repeats]}
        for name, repeats in runs.items()
    }
    save_columns("delay", options, columns, delay_report.ROWS, labels, details)


def _parser() -> Any:
    parser = bench_parser("delay", __doc__, EXAMPLES)
    add = parser.add_argument
    add("--protocol", metavar="LIST", type=PROTOCOLS, help="frame, mavlink, dronecan, vesc [the scenario's]")
    add("--stm32", metavar="LIST", type=STM32S, help=f"{', '.join(DRIVERS)} [the scenario's]")
    add("--baud", metavar="LIST", type=BAUDS, help="rate that the link is limited to, bit/s; 0: no limit [0]")
    add("--rate", metavar="LIST", type=RATES, help="commands a second [20]")
    add("--load", metavar="LIST", type=LOADS, help="number of busy processes beside it [0]")
    add_seconds(parser, 10.0, "configuration", least=0.1)
    add("--steps", type=STEPS, default=11, metavar="N", help="steps in surge, for the delay until motion [%(default)s]")
    add_repeat(parser, 1, "repetitions, each with new processes")
    add_connect(parser)
    add("--echo", metavar="HOST:UDP:TCP", type=_echo, help="endpoint of `uuv-hil bench echo` on the slave's machine")
    return parser


def _cases(options: Any) -> list[Case]:
    """Return every combination. Raises ConfigError."""
    defaults = {"baud": (0,), "rate": (20,), "load": (0,)}
    values = [getattr(options, key) or defaults.get(key, ("",)) for key in Case._fields]
    cases = [Case(*row) for row in itertools.product(*values)]
    if options.connect:
        _check_elsewhere(options)
    return cases


def _check_elsewhere(options: Any) -> None:
    """Check that no option would have to be passed to a slave that runs elsewhere. Raises ConfigError."""
    if any((options.under, options.protocol, options.stm32, options.baud)):
        raise ConfigError("--connect measures a running slave: leave out --under, --protocol, --stm32 and --baud")
    inapplicable = [key for key in changes_of(options) if not key.startswith(MASTER_KEYS)]
    if inapplicable:
        raise ConfigError(
            f"--set {inapplicable[0]}: --connect measures a running slave; change it in that slave's scenario"
        )


def _measure(case: Case, options: Any) -> tuple[Result, tuple[str, ...]]:
    plan = Plan(case.rate, options.seconds, case.load, options.steps)
    with Bench(options.scenario, _changes(case) | changes_of(options), options.under) as bench:
        result = measure(bench, plan, options.connect or "", options.echo)
        return result, (*bench.labels, *result.labels)


def _changes(case: Case) -> dict[str, Any]:
    """Return the changes to the scenario: without accelerometer errors, so that the first motion is detectable."""
    changes: dict[str, Any] = {f"sensors.imu.{name}": {} for name in ("attitude", "angular_velocity", "acceleration")}
    if case.rate > 100.0:
        changes["network.command_rate"] = 2.0 * case.rate
    if case.stm32:
        changes["stm32"] = case.stm32
    if case.protocol:
        changes["link.protocol"] = case.protocol
    if case.protocol in ON_CAN:
        changes["link.port"] = ON_CAN[case.protocol]
    if case.baud:
        changes["link.faults.baud"] = case.baud
    return changes


def _echo(text: str) -> Echo:
    """Parse HOST:UDP:TCP, as `uuv-hil bench echo` prints it."""
    name, udp, tcp = ([*text.rsplit(":", 2), "", ""])[:3]
    try:
        return host(name), ECHO_PORT(udp), ECHO_PORT(tcp)
    except ArgumentTypeError:
        words = f"expected HOST:UDP:TCP, as `uuv-hil bench echo` prints it, found {shortened(text)}"
        raise ArgumentTypeError(words) from None


def _figures(result: Result) -> dict[str, Figure]:
    """Return the figures of the record. A floor depends on the machine alone, so that a lower one is not "better"."""
    return {
        name: Figure(values, "ms", "" if name in delay_report.FLOORS else "lower")
        for name, values in result.values.items()
        if values or name == "delay"  # others were not measured
    }


def _details(run: Result) -> dict[str, Any]:
    """Return details of one run: commands sent and answered, their rate in Hz, and the floor above bare TCP in ms.

    Then the clocks' offset and its uncertainty in ms.
    """
    return {
        "sent": run.sent,
        "answered": len(run.values["delay"]),
        "rate": run.rate,
        "on the line": run.wire,
        "clock offset": run.clock_offset,
        "clock uncertainty": run.clock_uncertainty,
    }
