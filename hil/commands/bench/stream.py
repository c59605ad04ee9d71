"""`uuv-hil bench stream`: measure what reaches the master of every topic: rate, loss, age and bandwidth."""

from contextlib import ExitStack
from math import nan
from typing import Any

from hil.bench.harness import ONE_VEHICLE, Bench, labels_of
from hil.bench.record import Figure
from hil.bench.report import Column, text
from hil.bench.stream_run import ROWS, Listener, Listening
from hil.commands.bench.options import (
    PartialFailures,
    add_connect,
    add_repeat,
    add_seconds,
    bench_parser,
    benchmark,
    parse,
    save_columns,
    show,
)
from hil.common.errors import ConfigError
from hil.common.options import changes_of
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
SUMMED = ("rate", "bandwidth")  # over all topics


@benchmark
def main(arguments: list[str]) -> int:
    """Measure and print; return the exit code. Raises HilError."""
    parser = bench_parser("stream", __doc__, EXAMPLES)
    add_connect(parser)
    add_seconds(parser, 10.0, "run")
    add_repeat(parser, 1, "whole runs, each with a slave of its own")
    options = parse(parser, arguments)
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
    columns = _columns(runs)
    print(text(columns, ROWS, column_by_line=True))
    if options.repeat > 1:
        print(f"medians of {failures.most(options.repeat)} runs of {options.seconds:g} s")
    warnings = list(dict.fromkeys(warning for received in runs for warning in received.warnings))
    for warning in warnings:
        print(f"WARNING: {warning}")
    save_columns("stream", options, columns, ROWS, (*labels, *failures.labels), {"warnings": warnings})
    failures.raise_first()
    return 0


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


def _columns(runs: list[Listening]) -> list[Column]:
    """Return the figures of each topic, with a value for each run that has one, and last those of all topics."""
    topics = sorted({topic for received in runs for topic in received.streams})
    columns = []
    for topic in topics:
        streams = [received.streams.get(topic, {}) for received in runs]
        found = {row.name: Figure([each.get(row.name, nan) for each in streams], row.unit, row.better) for row in ROWS}
        columns.append(Column(topic, {name: figure.finite for name, figure in found.items()}))
    sums = {
        row.name: Figure([sum(each[row.name] for each in received.streams.values()) for received in runs], row.unit, "")
        for row in ROWS
        if row.name in SUMMED
    }
    return [*columns, Column("all", sums)]
