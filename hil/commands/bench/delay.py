"""`uuv-hil bench delay`: measure the delay of commands, hop by hop, beside the floor of the machine."""

import itertools
from argparse import ArgumentTypeError
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from hil.bench import delay_report
from hil.bench.delay_run import HOPS, Echo, Plan, Result, measure, pooled
from hil.bench.harness import Bench
from hil.bench.record import Figure
from hil.commands.bench.options import (
    add_repeat,
    add_results,
    add_seconds,
    add_under,
    benchmark,
    check_plot,
    save_record,
)
from hil.commands.bench.partial_failures import PartialFailures
from hil.commands.keys import add_machine, init
from hil.common.errors import ConfigError
from hil.common.options import (
    List,
    Number,
    add_scenario,
    changes_of,
    endpoint_or_lan,
    host,
    integer,
    new_parser,
    one_of,
)
from hil.common.schema import shortened
from hil.common.scratch import ScratchFolder
from hil.slave.drivers.driver import DRIVERS

EXAMPLES = """\
Options that take LIST measure every combination: --baud 0,115200 --load 0,2 are four configurations. A baud paces
the link as a UART of that speed would; 0 does not limit it. The floor is bare UDP and TCP between the same machines
in the same seconds, and the frame's time on its line.

For a slave elsewhere, start `uuv-hil bench echo` beside it and name its ports. There is no floor
without it, and --payload needs it.

To compare two versions of a program, --repeat 5: two starts of one program differ too.

examples:
  uuv-hil bench delay
  uuv-hil bench delay --stm32 python,process,native,unicorn --baud 0,115200 --plot delay.png
  uuv-hil bench delay --protocol frame,mavlink --security off,on
  uuv-hil bench delay --protocol vesc,dronecan --load 0,2
  uuv-hil bench delay --rate 10,50,100 --payload 0,100000 --seconds 30 --output delay.json
  uuv-hil bench delay --connect tcp/192.168.3.116:7447 --echo 192.168.3.116:40001:40002
  uuv-hil bench delay --most-over-floor 0.8 --most-p99 3      exit code 1 when a configuration takes longer (ms)
"""
LIMIT_BROKEN = 1
ECHO_PORT = integer(1, 65_535)
STEPS = integer(0, 1000)
LIMIT = Number(-1e6, 1e6, "ms")  # a delay above the floor can be negative
PROTOCOLS = List(one_of("frame", "mavlink", "dronecan", "vesc"))
STM32S = List(one_of(*DRIVERS))
SWITCH = List(one_of("off", "on"))
BAUDS = List(integer(1200, 12_000_000, also=(0,)))
RATES = List(Number(1.0, 1000.0, "Hz"))
LOADS = List(integer(0, 1024))
PAYLOADS = List(integer(0, 1 << 26))
MASTER_KEYS = ("network.", "security.", "slave.node")  # keys of a scenario that the master here uses
ON_CAN = {"dronecan": "can:virtual:bench", "vesc": "can:virtual:bench"}  # default ports


class Case(NamedTuple):
    """One configuration."""

    protocol: str
    stm32: str
    baud: int
    security: str
    rate: float
    load: int
    payload: int

    def name(self, changing: list[str]) -> str:
        """Return a name from the values of the fields in `changing`."""
        values = {key: getattr(self, key) for key in changing}
        words = [f"{key} {value:g}" if isinstance(value, float) else f"{key} {value}" for key, value in values.items()]
        return ", ".join(words) or "as the scenario has it"


@benchmark
def main(arguments: list[str]) -> int:
    """Measure and print; return 0, or 1 when a limit is broken. Raises HilError."""
    options = _parser().parse_args(arguments)
    check_plot(options)
    cases, echo = _cases(options), options.echo
    given = {key: getattr(options, key) for key in Case._fields if getattr(options, key) is not None}
    changing = [key for key, values in given.items() if len(values) > 1] or list(given)
    runs: dict[str, list[Result]] = {}
    labels: tuple[str, ...] = ()
    failures = PartialFailures()
    with failures.caught():
        for number, (_, case) in enumerate(itertools.product(range(options.repeat), cases), 1):
            name = case.name(changing)
            failures.begin(f"{number} of {options.repeat * len(cases)}: {name}")
            result, labels = _measure(case, options, echo)
            runs.setdefault(name, []).append(result)
    if not runs:
        failures.raise_first()
    broken = _report(runs, (*labels, *failures.labels), options)
    failures.raise_first()
    return LIMIT_BROKEN if broken else 0


def _report(runs: dict[str, list[Result]], labels: tuple[str, ...], options: Any) -> list[str]:
    """Print, save and draw the results; return the limits that are broken. Raises ConfigError."""
    results = {name: pooled(repeats) for name, repeats in runs.items()}
    print(delay_report.text(results))
    figures = {f"{row} [{name}]": figure for name, repeats in runs.items() for row, figure in _figures(repeats).items()}
    details = {
        name: {"warnings": results[name].warnings, "runs": [_details(result) for result in repeats]}
        for name, repeats in runs.items()
    }
    record = save_record("delay", options, figures, labels, details)
    broken = [text for name, result in results.items() for text in _broken(name, result, options)]
    for text in broken:
        print(f"LIMIT BROKEN: {text}")
    if options.plot:
        delay_report.draw(results, record, options.plot)
    return broken


def _parser() -> Any:
    parser = new_parser("bench delay", __doc__, EXAMPLES)
    add_scenario(parser)
    add = parser.add_argument
    add("--protocol", metavar="LIST", type=PROTOCOLS, help="frame, mavlink, dronecan, vesc [the scenario's]")
    add("--stm32", metavar="LIST", type=STM32S, help=f"{', '.join(DRIVERS)} [the scenario's]")
    add("--baud", metavar="LIST", type=BAUDS, help="rate that the link is limited to, bit/s; 0: no limit [0]")
    add("--security", metavar="LIST", type=SWITCH, help="off, on: certificates made for the purpose [the scenario's]")
    add("--rate", metavar="LIST", type=RATES, help="commands a second [20]")
    add("--load", metavar="LIST", type=LOADS, help="number of busy processes beside it [0]")
    add("--payload", metavar="LIST", type=PAYLOADS, help="extra bytes on the network with each command [0]")
    add("--port", metavar="ADDRESS", help="address of the thruster link")
    add_seconds(parser, 10.0, "configuration", least=0.1)
    add("--steps", type=STEPS, default=11, metavar="N", help="steps in surge, for the delay until motion [%(default)s]")
    add_repeat(parser, 1, "repetitions, each with new processes")
    add("--connect", metavar="ENDPOINT", type=endpoint_or_lan, help="endpoint of a running slave, or lan")
    add("--echo", metavar="HOST:UDP:TCP", type=_echo, help="endpoint of `uuv-hil bench echo` on the slave's machine")
    add("--most-p50", type=LIMIT, metavar="MS", help="limit of the median")
    add("--most-p99", type=LIMIT, metavar="MS", help="limit of 99 of 100 commands")
    add("--most-over-floor", type=LIMIT, metavar="MS", help="limit of the median above the floor")
    add_under(parser)
    add_results(parser, "histogram, time series and hops")
    return parser


def _cases(options: Any) -> list[Case]:
    """Return every combination. Raises ConfigError."""
    defaults = {"baud": (0,), "rate": (20,), "load": (0,), "payload": (0,)}
    values = [getattr(options, key) or defaults.get(key, ("",)) for key in Case._fields]
    cases = [Case(*row) for row in itertools.product(*values)]
    if options.connect:
        _check_elsewhere(options, cases)
    return cases


def _check_elsewhere(options: Any, cases: list[Case]) -> None:
    """Check that no option would have to be passed to a slave that runs elsewhere. Raises ConfigError."""
    if any((options.under, options.protocol, options.stm32, options.baud, options.port)):
        raise ConfigError(
            "--connect measures a running slave: leave out --under, --protocol, --stm32, --baud and --port"
        )
    inapplicable = [key for key in changes_of(options) if not key.startswith(MASTER_KEYS)]
    if inapplicable:
        raise ConfigError(
            f"--set {inapplicable[0]}: --connect measures a running slave; change it in that slave's scenario"
        )
    if any(case.security == "on" for case in cases):
        raise ConfigError(
            "--security on: makes keys that the slave of --connect does not have; leave it out, and name the "
            "SCENARIO with this machine's in its [security] section"
        )
    if options.echo:
        return
    if any(case.payload for case in cases):
        raise ConfigError(
            "--payload: needs a receiver: run `uuv-hil bench echo` beside the slave, and name it with --echo"
        )
    if options.most_over_floor is not None:
        raise ConfigError(
            "--most-over-floor: there is no floor without `uuv-hil bench echo` beside --connect, and --echo"
        )


def _measure(case: Case, options: Any, echo: Echo | None) -> tuple[Result, tuple[str, ...]]:
    plan = Plan(case.rate, options.seconds, case.load, case.payload, options.steps)
    with _keys(case.security) as security:
        changes = {**changes_of(options), **_changes(case, options), **security}
        with Bench(options.scenario, changes, options.under) as bench:
            result = measure(bench, plan, options.connect or "", echo)
            return result, (*bench.labels, *result.labels)


def _changes(case: Case, options: Any) -> dict[str, Any]:
    """Return the changes to the scenario: without accelerometer errors, so that the first motion is detectable."""
    changes: dict[str, Any] = {f"sensors.imu.{name}": {} for name in ("attitude", "angular_velocity", "acceleration")}
    if case.rate > 100.0:
        changes["network.command_rate"] = 2.0 * case.rate
    if case.stm32:
        changes["stm32"] = case.stm32
    if case.protocol:
        changes["link.protocol"] = case.protocol
    port = options.port or ON_CAN.get(case.protocol)
    if port:
        changes["link.port"] = port
    if case.baud:
        changes["link.faults.baud"] = case.baud
    return changes


@contextmanager
def _keys(choice: str) -> Iterator[dict[str, Any]]:
    """Provide the scenario's [security] section of this choice, with certificates of its own."""
    if choice != "on":
        yield {} if not choice else {"security": None}
        return
    with ScratchFolder("keys") as folder:
        keys = folder.file("keys")
        init(keys)
        machines = {f"security.{name}": add_machine(keys, name, ["localhost"]) for name in ("slave", "master")}
        yield {"security": {}, **machines, "security.may_command": ["master"]}


def _echo(text: str) -> Echo:
    """Parse HOST:UDP:TCP, as `uuv-hil bench echo` prints it."""
    name, udp, tcp = ([*text.rsplit(":", 2), "", ""])[:3]
    try:
        return host(name), ECHO_PORT(udp), ECHO_PORT(tcp)
    except ArgumentTypeError:
        words = f"expected HOST:UDP:TCP, as `uuv-hil bench echo` prints it, found {shortened(text)}"
        raise ArgumentTypeError(words) from None


def _figures(runs: list[Result]) -> dict[str, Figure]:
    """Return the figures of the record. A floor depends on the machine alone, so that a lower one is not "better"."""
    series: dict[str, list[list[float]]] = {
        "delay": [run.delay for run in runs],
        "motion": [run.motion for run in runs],
        "udp floor": [run.udp for run in runs],
        "tcp floor": [run.tcp for run in runs],
        **{f"hop {hop}": [run.hops[hop] for run in runs] for hop in HOPS},
    }
    return {
        name: Figure(
            [value for values in of_runs for value in values],
            "ms",
            "" if name in ("udp floor", "tcp floor", "hop wire") else "lower",
            tuple(map(len, of_runs)),
        )
        for name, of_runs in series.items()
        if any(of_runs) or name == "delay"  # others were not measured
    }


def _details(run: Result) -> dict[str, Any]:
    """Return details of one run: commands sent and answered, their rate in Hz, and the floor above bare TCP in ms.

    Then the clocks' offset and its uncertainty in ms, and when each command of the figures was published, in s.
    """
    return {
        "sent": run.sent,
        "answered": len(run.delay),
        "rate": run.rate,
        "on the line": run.wire,
        "clock offset": run.clock_offset,
        "clock uncertainty": run.clock_uncertainty,
        "at_s": [round(at, 6) for at in run.at_s],
    }


def _broken(name: str, result: Result, options: Any) -> list[str]:
    limits = (
        ("p50", result.at(0.5), options.most_p50),
        ("p99", result.at(0.99), options.most_p99),
        ("p50 above the floor", result.at(0.5) - result.floor, options.most_over_floor),
    )
    return [
        f"{name}: {what} {value:.3f} ms is above {limit:g} ms"
        for what, value, limit in limits
        if limit is not None and not value <= limit
    ]
