"""`uuv-hil bench stream`: what reaches the master of every topic: rate, loss, age and bandwidth."""

from contextlib import ExitStack
from typing import Any

from hil.bench.harness import Bench
from hil.bench.record import Figure, new_record
from hil.bench.stream_run import Listener, Stream, nominal_hz
from hil.columns import aligned
from hil.commands.bench_options import add_json, add_limits, add_scenario, changes_of, keep, limits_of, show
from hil.commands.parser import new_parser
from hil.config import Scenario, load_scenario
from hil.errors import ConfigError

EXAMPLES = """\
Loss is by sequence numbers, age from publish to receipt by the estimated offset of the two clocks (0 on one machine).
A vehicle elsewhere is only listened to; without --slave one is started here.

examples:
  uuv-hil bench stream --seconds 30
  uuv-hil bench stream --slave tcp/192.168.3.116:7447 --json wlan.json
  uuv-hil bench stream --set sensors.laser.rate=20 --set sensors.imu.rate=400
"""


def main(arguments: list[str]) -> int:
    """Measure and print; the exit code. Raises HilError."""
    parser = new_parser("bench stream", __doc__, EXAMPLES)
    add_scenario(parser)
    parser.add_argument("--slave", metavar="ENDPOINT", help="a slave elsewhere [one is started here]")
    parser.add_argument("--seconds", type=float, default=10.0, metavar="S", help="[%(default)s]")
    add_limits(parser)
    add_json(parser)
    options = parser.parse_args(arguments)
    if not 1.0 <= options.seconds <= 86_400.0:
        raise ConfigError("command line: --seconds is from 1 to 86400")
    streams, scenario, labels = _listen(options)
    print("\n".join(_table(streams, scenario)))
    settings = {key: getattr(options, key) for key in ("scenario", "set", "slave", "seconds")}
    keep(new_record("stream", settings, _figures(streams), labels), options)
    return 0


def _listen(options: Any) -> tuple[list[Stream], Scenario, tuple[str, ...]]:
    with ExitStack() as stack:
        stack.callback(show, "")
        if options.slave:
            scenario, labels = load_scenario(options.scenario), ()
            listener = Listener(options.slave, scenario.slave.node, scenario.network, scenario.security)
            return stack.enter_context(listener).listen(options.seconds), scenario, labels
        bench = stack.enter_context(Bench(options.scenario, changes_of(options), limits_of(options)))
        slave = bench.start_slave()
        scenario = bench.scenario
        show(f"listening for {options.seconds:g} s")
        listener = Listener(bench.endpoint, scenario.slave.node, scenario.network, scenario.security)
        return stack.enter_context(listener).listen(options.seconds, slave), scenario, bench.labels


def _table(streams: list[Stream], scenario: Scenario) -> list[str]:
    rates = {name: fitted.model.rate for name, fitted in scenario.sensors.items()} | {
        "/clock": scenario.ros.clock, "thruster_wrench": scenario.ros.wrench,
    }  # fmt: skip
    rows = [["topic", "Hz", "nominal", "loss", "age p50 ms", "p99 ms", "kB/s"]]
    for stream in streams:
        nominal = nominal_hz(stream.topic, rates)
        rows.append(
            [
                stream.topic,
                f"{stream.rate:.1f}",
                f"{nominal:g}" if nominal else "-",
                f"{stream.loss:.3%}",
                f"{stream.age_p50:.3f}",
                f"{stream.age_p99:.3f}",
                f"{stream.bytes_s / 1e3:.2f}",
            ]
        )
    total = sum(stream.rate for stream in streams), sum(stream.bytes_s for stream in streams)
    rows.append(["all", f"{total[0]:.1f}", "", "", "", "", f"{total[1] / 1e3:.2f}"])
    return aligned(rows, rule=True)


def _figures(streams: list[Stream]) -> dict[str, Figure]:
    found: dict[str, Figure] = {}
    for stream in streams:
        found[f"{stream.topic} rate"] = Figure([stream.rate], "Hz", "higher")
        found[f"{stream.topic} loss"] = Figure([100.0 * stream.loss], "%")
        found[f"{stream.topic} age p50"] = Figure([stream.age_p50], "ms")
        found[f"{stream.topic} age p99"] = Figure([stream.age_p99], "ms")
        found[f"{stream.topic} bandwidth"] = Figure([stream.bytes_s], "bytes/s", "")
    return found
