"""`uuv-hil bench stream`: measure what reaches the master of every topic: rate, loss, age and bandwidth."""

from contextlib import ExitStack
from math import isnan
from typing import Any

from hil.bench.harness import ONE_VEHICLE, Bench, labels_of
from hil.bench.record import Better, Figure
from hil.bench.statistics import median
from hil.bench.stream_run import Listener, Listening, Stream, missing
from hil.commands.bench.options import (
    add_repeat,
    add_results,
    add_seconds,
    add_under,
    benchmark,
    save_record,
    show,
)
from hil.commands.bench.partial_failures import PartialFailures
from hil.common.columns import aligned
from hil.common.errors import ConfigError
from hil.common.options import add_scenario, changes_of, endpoint_or_lan, new_parser
from hil.scenario.config import load_single

EXAMPLES = """\
Loss is counted by sequence numbers. "missing" is the difference from the nominal rate, with messages that were never
sent. Age is the time from publication to receipt, by the estimated offset of the two clocks (0 on one machine). A topic
that a slave of the scenario should send but does not has a row of 0 Hz. With --connect it only listens to a running
slave; without, it starts one here.

examples:
  uuv-hil bench stream --seconds 30
  uuv-hil bench stream --connect tcp/192.168.3.116:7447 --output wlan.json
  uuv-hil bench stream --set sensors.laser.rate=20 --set sensors.imu.rate=400
  uuv-hil bench stream --repeat 5 --output today.json
"""
# Figures of the record: a field of Stream, its name in the record, unit, factor to that unit, and which is better.
ROWS: tuple[tuple[str, str, str, float, Better], ...] = (
    ("rate", "rate", "Hz", 1.0, "higher"),
    ("loss", "loss", "%", 100.0, "lower"),
    ("missing", "missing", "%", 100.0, "lower"),
    ("age_p50", "age p50", "ms", 1.0, "lower"),
    ("age_p99", "age p99", "ms", 1.0, "lower"),
    ("bytes_s", "bandwidth", "bytes/s", 1.0, ""),
)


@benchmark
def main(arguments: list[str]) -> int:
    """Measure and print; return the exit code. Raises HilError."""
    options = _parser().parse_args(arguments)
    if options.connect and (options.set or options.under):
        raise ConfigError(
            "command line: --set and --under change a slave started here, not --connect; "
            "start that slave with its own options, and give its scenario as a file"
        )
    runs: list[Listening] = []
    labels: tuple[str, ...] = ()
    failures = PartialFailures()
    with failures.caught():
        for number in range(options.repeat):
            progress = f"run {number + 1} of {options.repeat}"
            failures.begin(progress)
            received, labels = _listen(options, progress)
            runs.append(received)
    if not runs:
        failures.raise_first()
    streams = _by_topic(runs)
    print("\n".join(_table(streams)))
    if options.repeat > 1:
        print(f"medians of {failures.most(options.repeat)} runs of {options.seconds:g} s")
    silent_topics = [topic for topic, of_runs in streams.items() if _is_silent(of_runs, options.seconds)]
    if silent_topics:
        print(f"nothing was received on {', '.join(silent_topics)}, though a slave of this scenario should send it")
    warnings = list(dict.fromkeys(warning for received in runs for warning in received.warnings))
    for warning in warnings:
        print(f"WARNING: {warning}")
    figures = _figures(streams, bool(options.connect))
    save_record("stream", options, figures, (*labels, *failures.labels), {"warnings": warnings})
    failures.raise_first()
    return 0


def _parser() -> Any:
    parser = new_parser("bench stream", __doc__, EXAMPLES)
    add_scenario(parser)
    add = parser.add_argument
    add(
        "--connect",
        metavar="ENDPOINT",
        type=endpoint_or_lan,
        help="a running slave, or lan [one is started here]",
    )
    add_seconds(parser, 10.0, "run")
    add_repeat(parser, 1, "whole runs, each with a slave of its own")
    add_under(parser)
    add_results(parser)
    return parser


def _listen(options: Any, progress: str) -> tuple[Listening, tuple[str, ...]]:
    """Run once; return the result and the labels of its figures."""

    def watch(share: float) -> None:
        show(f"{progress}: listening for {options.seconds:g} s {min(share, 1.0):4.0%}")

    with ExitStack() as stack:
        if options.connect:
            show(f"{progress}: waiting for {options.connect}")
            listener = stack.enter_context(Listener(options.connect, load_single(options.scenario, remedy=ONE_VEHICLE)))
            received = listener.listen(options.seconds, None, watch)
            return received, labels_of(listener.client.diagnostics())
        bench = stack.enter_context(Bench(options.scenario, changes_of(options), options.under))
        slave = bench.start_slave()
        listener = stack.enter_context(Listener(bench.endpoint, bench.scenario))
        return listener.listen(options.seconds, slave, watch), bench.labels


def _by_topic(runs: list[Listening]) -> dict[str, list[Stream]]:
    by_topic: dict[str, list[Stream]] = {}
    for received in runs:
        for stream in received.streams:
            by_topic.setdefault(stream.topic, []).append(stream)
    return dict(sorted(by_topic.items()))


def _is_silent(streams: list[Stream], seconds: float) -> bool:
    """Return whether nothing was received in all runs of `seconds`, though more than one message was due."""
    silent = not any(stream.rate for stream in streams)
    return silent and missing(0, streams[0].nominal, len(streams) * seconds) > 0.0


def _values(streams: list[Stream], field: str) -> list[float]:
    """Return the values of a field, of each run that has it."""
    return [value for value in (getattr(stream, field) for stream in streams) if not isnan(value)]


def _table(streams: dict[str, list[Stream]]) -> list[str]:
    rows = [["topic", "Hz", "nominal", "loss", "missing", "age p50 ms", "p99 ms", "kB/s"]]
    forms = {"rate": "{:.1f}", "nominal": "{:g}", "loss": "{:.3%}", "missing": "{:.3%}"}
    forms |= {"age_p50": "{:.3f}", "age_p99": "{:.3f}"}
    total = [0.0, 0.0]
    for topic, of_runs in streams.items():
        cells = [forms[field].format(median(values)) if (values := _values(of_runs, field)) else "-" for field in forms]
        rate, bytes_s = (median(_values(of_runs, field)) for field in ("rate", "bytes_s"))
        rows.append([topic, *cells, f"{bytes_s / 1e3:.2f}"])
        total = [total[0] + rate, total[1] + bytes_s]
    rows.append(["all", f"{total[0]:.1f}", *[""] * 5, f"{total[1] / 1e3:.2f}"])
    return aligned(rows, rule=True)


def _figures(streams: dict[str, list[Stream]], elsewhere: bool) -> dict[str, Figure]:
    """Return a value for each run, which is a start of the slave unless that is `elsewhere`."""
    figures: dict[str, Figure] = {}
    for topic, of_runs in streams.items():
        for field, name, unit, factor, better in ROWS:
            values = [factor * value for value in _values(of_runs, field)]
            if values:
                runs = (len(values),) if elsewhere else (1,) * len(values)
                figures[f"{topic} {name}"] = Figure(values, unit, better, runs)
    return figures
