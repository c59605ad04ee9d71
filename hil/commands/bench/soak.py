"""`uuv-hil bench soak`: run for hours; check that no memory grows, no time drifts and masters always reconnect."""

from math import isnan, nan
from typing import Any

from hil.bench.harness import Bench
from hil.bench.record import Figure, Record, median
from hil.bench.soak_run import Observation, Soak, Soaking, measured, trend
from hil.commands.bench.options import bench_parser, benchmark, parse, save_record, show
from hil.common.errors import STOPPED, ConfigError
from hil.common.options import Number, changes_of
from hil.common.stop import StopSignals
from hil.plots.plotting import pyplot, save_figure

EXAMPLES = """\
The slave gets 20 commands a second; the master disconnects and reconnects from time to time. Growth is the slope of a
straight line through the slave's private memory, without the first tenth of the run, with its interval of 95 %. It is
reported as a leak after half an hour, when the interval is above 0 and the slope above --leak. A slave that ends,
hangs or cannot be reached is a finding. Ctrl-C ends the run early and judges the readings so far.

examples:
  uuv-hil bench soak --hours 8 --output soak.json --plot soak.png
  uuv-hil bench soak --hours 0.05 --every 2 --leave-every 30
"""
FOUND = 1
HOURS = Number(0.001, 10_000.0, "h")
EVERY = Number(0.2, 1e6, "s")
LEAK = Number(0.0, 1e6, "MiB")
LATE_S = 1.0  # a reconnection that takes longer is reported
LEAK_AFTER_S = 1800.0  # earlier, caches and buffers that fill once look like a leak
# Figures of the record and the picture: a field of Observation, title, unit, whether it is in the picture.
SERIES = (
    ("private", "private memory", "MiB", True),
    ("memory", "memory", "MiB", False),
    ("delay_p50_ms", "delay p50", "ms", True),
    ("real_time_factor", "real-time factor", "", True),
    ("steps_skipped", "steps skipped", "steps", True),
    ("threads", "threads", "", False),
    ("descriptors", "descriptors", "", True),
    ("at_s", "at", "s", False),
)


@benchmark
def main(arguments: list[str]) -> int:
    """Run and judge; return 0, or 1 when something grows, drifts, hangs or does not reconnect. Raises HilError."""
    options = parse(_parser(), arguments)
    if options.every >= options.leave_every:
        raise ConfigError("command line: --every must be below --leave-every")
    if options.every >= options.hours * 3600.0:
        raise ConfigError("command line: --hours ends before the first reading; give a shorter --every")
    with StopSignals() as stop_fd, Bench(options.scenario, changes_of(options), options.under) as bench:
        soak = Soaking(bench, options.every, _show, stop_fd).run(options.hours * 3600.0, options.leave_every)
        labels = bench.labels
    show("")
    if not soak.observations and not soak.silences:
        print("ended before the first reading")
        return STOPPED
    findings = judge(soak, options.leak)
    record = _record(soak, findings, options, labels)
    if options.plot:
        _draw(soak, record, options.plot)
    return FOUND if findings else 0


def _parser() -> Any:
    parser = bench_parser("soak", __doc__, EXAMPLES)
    add = parser.add_argument
    add("--hours", type=HOURS, default=1.0, metavar="H", help="[%(default)s]")
    add("--every", type=EVERY, default=10.0, metavar="S", help="time between readings [%(default)s]")
    add(
        "--leave-every",
        type=EVERY,
        default=300.0,
        metavar="S",
        help="time between disconnections of the master [%(default)s]",
    )
    add("--leak", type=LEAK, default=0.5, metavar="MIB", help="growth an hour that counts as a leak [%(default)s]")
    return parser


def _show(observation: Observation) -> None:
    show(
        f"{observation.at_s / 3600.0:.2f} h: {observation.private:.2f} MiB, {observation.threads} threads, "
        f"{observation.descriptors} descriptors, "
        f"{observation.steps_skipped:.0f} steps skipped, delay p50 {observation.delay_p50_ms:.2f} ms"
    )


def judge(soak: Soak, leak: float) -> list[str]:
    """Print the figures; return the findings."""
    observations = soak.observations[len(soak.observations) // 10 :]
    print(f"{observations[-1].at_s / 3600.0 if observations else 0.0:.3f} h, {len(soak.observations)} readings")
    bad = _judge_observations(observations, leak) if observations else []
    bad += _judge_returns(soak.returns)
    for at_s, seconds, reason in soak.silences:
        bad.append(f"silence from {at_s / 3600.0:.3f} h on, for {seconds:.1f} s: {reason}")
    for text in bad:
        print(f"FOUND: {text}")
    return bad


def _judge_observations(observations: list[Observation], leak: float) -> list[str]:
    first, last = observations[0], observations[-1]
    bad = _judge_memory(observations, leak)
    print(f"threads {first.threads} -> {last.threads}, descriptors {first.descriptors} -> {last.descriptors}")
    if last.descriptors > first.descriptors + 5:
        bad.append(f"descriptors grow from {first.descriptors} to {last.descriptors}")
    factors, skipped = (
        measured([getattr(observation, name) for observation in observations])
        for name in ("real_time_factor", "steps_skipped")
    )
    if factors:
        print(f"real-time factor {factors[-1]:.4f}, {skipped[-1]:.0f} steps skipped")
        if abs(factors[-1] - 1.0) > 1e-3:
            bad.append(f"time drifts: the real-time factor is {factors[-1]:.4f}")
    delays = measured([observation.delay_p50_ms for observation in observations])
    print(f"command delay p50: median {median(delays):.3f} ms, at most {max(delays, default=nan):.3f} ms")
    return bad


def _judge_memory(observations: list[Observation], leak: float) -> list[str]:
    """Judge the slave's private memory: its share of the rest changes with other processes."""
    first, last = observations[0], observations[-1]
    slope, low, high = trend(
        [observation.at_s for observation in observations], [observation.private for observation in observations]
    )
    if isnan(slope):
        print("memory: too few readings for a line")
        return []
    print(f"private memory: {first.private:.2f} -> {last.private:.2f} MiB; {slope:+.3f} MiB an hour "
          f"({low:+.3f} to {high:+.3f}); in all {last.memory:.2f} MiB")  # fmt: skip
    if last.at_s < LEAK_AFTER_S:
        print(f"no verdict on memory: that takes {LEAK_AFTER_S / 60.0:.0f} minutes")
        return []
    grows = slope > leak and low > 0.0
    return [f"memory grows by {slope:.2f} MiB an hour"] if grows else []


def _judge_returns(returns: list[float | None]) -> list[str]:
    reconnected = [seconds for seconds in returns if seconds is not None]
    if not returns:
        return []
    slowest = max(reconnected, default=nan)
    print(
        f"the master reconnected {len(reconnected)} of {len(returns)} times; first sample after {slowest:.3f} s at most"
    )
    missed = len(returns) - len(reconnected)
    bad = [f"a master that reconnected got no sample ({missed} of {len(returns)} times)"] if missed else []
    return bad + ([f"a reconnection took {slowest:.1f} s"] if slowest > LATE_S else [])


def _record(soak: Soak, findings: list[str], options: Any, labels: tuple[str, ...]) -> Record:
    figures: dict[str, Figure] = {}
    for field, name, unit, _ in SERIES:
        values = [float(getattr(observation, field)) for observation in soak.observations]
        figures[name] = Figure(values, unit, "lower" if unit in ("MiB", "ms") else "")
    figures["return"] = Figure([seconds for seconds in soak.returns if seconds is not None], "s")
    details = {"found": findings, "silences": [silence._asdict() for silence in soak.silences]}
    return save_record("soak", options, figures, labels, details)


def _draw(soak: Soak, record: Record, path: str) -> None:
    plt = pyplot()
    drawn = [row for row in SERIES if row[3]]
    figure, panels = plt.subplots(len(drawn), 1, figsize=(10, 11), layout="constrained", sharex=True)
    hours = [observation.at_s / 3600.0 for observation in soak.observations]
    for panel, (field, name, unit, _) in zip(panels, drawn, strict=True):
        panel.plot(hours, [getattr(observation, field) for observation in soak.observations])
        panel.set(ylabel=f"{name} ({unit})" if unit not in ("", "steps") else name)
        panel.ticklabel_format(axis="y", useOffset=False)
        for at_s, seconds, _ in soak.silences:
            panel.axvspan(at_s / 3600.0, (at_s + seconds) / 3600.0, color="C3", alpha=0.2)
    panels[-1].set(xlabel="time (h)")
    figure.supxlabel(record.footer, fontsize="x-small", color="0.4")
    save_figure(figure, path)
