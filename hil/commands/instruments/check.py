"""`uuv-hil instruments check`: show what a driver sees at each wire of the instruments, and how late."""

from typing import Any

from hil.bench.harness import Bench
from hil.bench.instruments.run import Seen, check
from hil.commands.listening import add_connect
from hil.common.columns import aligned
from hil.common.errors import ConfigError
from hil.common.options import Number, add_json, add_scenario, changes_of, new_parser
from hil.common.text import clean, json_text

EXAMPLES = """\
It starts the slave and its instruments here, or only the instruments for a slave at --connect, which has
instruments = false in [slave]. It reads the bytes by itself, asks where a driver has to ask, and checks the checksums.
The delay is from the instant of the measurement to its last byte, of HTTP from the request to the last byte of the
answer; "line" is the time that its bytes take on a serial line of that speed, "maker" the delay that the maker names.
The exit code is 1 if a wire is silent or damaged.

examples:
  uuv-hil instruments check bluerov2_desk
  uuv-hil instruments check mine.toml --seconds 60 --json
"""
SHOWN = 100  # characters of a message


def main(arguments: list[str]) -> int:
    """Read the wires and print; return the exit code."""
    parser = new_parser("instruments check", __doc__, EXAMPLES)
    add_scenario(parser, None)
    add_connect(parser)
    parser.add_argument(
        "--seconds", metavar="S", type=Number(1.0, 86_400.0, "s"), default=10.0, help="time to read [%(default)g s]"
    )
    add_json(parser)
    options = parser.parse_args(arguments)
    if options.connect and len(options.connect) > 1:
        raise ConfigError("command line: --connect: one slave is checked at a time; give one endpoint")
    with Bench(options.scenario, {"slave.instruments": False, **changes_of(options)}) as bench:
        if not any(spec.instrument for spec in bench.scenario.sensors.values()):
            raise ConfigError(f"{options.scenario}: no sensor is an instrument: add the key `instrument` to one")
        seen = check(bench, options.seconds, options.connect[0] if options.connect else "")
    print(json_text([_plain(each) for each in seen], 1) if options.json else "\n".join(_lines(seen)))
    return int(any(each.problem for each in seen))


def _lines(seen: list[Seen]) -> list[str]:
    lines: list[str] = []
    for each in seen:
        lines += ["", f"{each.sensor}: {each.instrument} at {each.at}{f': {each.remark}' if each.remark else ''}"]
        rows = [
            (
                f"{message.kind}  {message.number}  {message.number / each.seconds:.1f} Hz"
                + (f"  {message.bad} damaged" if message.bad else ""),
                clean(message.last, SHOWN),
            )
            for message in each.messages
        ]
        lines += aligned(rows, indent="  ")
        if each.measurements:
            line = f", line {each.line_ms:.1f} ms" if each.line_ms > 0.0 else ""
            maker = f", maker {each.own_ms:g} ms" if each.own_ms else ""
            delay = f"delay p50 {each.delay_p50_ms:.2f} ms, p99 {each.delay_p99_ms:.2f} ms"
            lines.append(f"  {delay} ({each.measurements} measurements){line}{maker}")
        if each.problem:
            lines.append(f"  problem: {each.problem}")
    return lines[1:]


def _plain(seen: Seen) -> dict[str, Any]:
    messages = [message._asdict() for message in seen.messages]
    return {**seen._asdict(), "messages": messages, "problem": seen.problem}
