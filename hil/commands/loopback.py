"""`uuv-hil link loopback`: measure losses and round trips of a thruster link, with both ends here or one."""

import json
import sys
from typing import Any

from hil.bench.loopback import Plan, Result, run
from hil.common.clock import NS_PER_MS
from hil.common.columns import fit_to_terminal
from hil.common.options import DAY_S, SEED, Number, Quantity, Share, add_json, integer, new_parser
from hil.common.schema import parse
from hil.common.streams import ProgressLine
from hil.common.tables import settings
from hil.links.options import add_link
from hil.links.wires.faults import Faults
from hil.scenario.records import Link
from hil.slave.drivers.driver import DRIVERS

EXAMPLES = """\
Without --port both ends are here, on a pseudo terminal. With --port only one end is here: at the other end is an
STM32 (`--stm32 device`), or TX is connected to RX (`--stm32 jumper`). A real STM32 gets disarmed commands, which
move nothing, unless --spin is given: take the propellers off first.

examples:
  uuv-hil link loopback                                               both ends, a pty
  uuv-hil link loopback --fault baud=115200 --rate 0                  paced as a UART, as many commands as it carries
  uuv-hil link loopback --protocol mavlink --stm32 unicorn            the firmware image, MAVLink
  uuv-hil link loopback --protocol vesc --port can:virtual:bus0
  uuv-hil link loopback --fault drop=0.05 --fault delay="20 ms" --max-loss 0.12
  uuv-hil link loopback --stm32 device --port /dev/ttyUSB0 --baud 921600 --max-p99 "5 ms"
  uuv-hil link loopback --stm32 jumper --port /dev/serial0 --json
"""
LIMIT_BROKEN = 1
RATE = Number(0.01, 10_000.0, "Hz", also=(0,))
SECONDS = Number(0.01, DAY_S, "s")
ERRORS = integer(0, 10**9)
LIMIT = Quantity(0.0, 1000.0, "s")


def main(arguments: list[str]) -> int:
    """Test one link; return 0, or 1 if a limit is broken. Raises HilError."""
    options = _parser().parse_args(arguments)
    plan = Plan(
        options.stm32, link_of(options), options.channels, options.rate, options.seconds,
        options.spin or options.stm32 not in ("device",), options.seed,
    )  # fmt: skip
    line = ProgressLine()
    result = run(
        plan,
        lambda text: print(text, file=sys.stderr),
        lambda sent, answered: line.show(f"{sent} sent, {answered} answered"),
    )
    line.clear()
    broken = _broken(result, options)
    if options.json:
        print(json.dumps(_record(result, broken), indent=2))
    else:
        print(fit_to_terminal(_text(result, plan, broken), " " * 12))
    return LIMIT_BROKEN if broken else 0


def _parser() -> Any:
    parser = new_parser("link loopback", __doc__, EXAMPLES)
    add_link(parser, "pty:")
    add = parser.add_argument
    kinds = [*DRIVERS, "jumper"]
    about = f"device at the other end: {', '.join(kinds)} [%(default)s]"
    add("--stm32", metavar="NAME", default="python", choices=kinds, help=about)
    add("--rate", type=RATE, default=50.0, metavar="HZ", help="commands a second; 0: one at a time [%(default)s]")
    add("--seconds", type=SECONDS, default=5.0, metavar="S", help="duration of the test [%(default)s]")
    fault = "baud, drop, corrupt, delay ... on our end"
    add("--fault", "--faults", action="append", default=[], metavar="NAME=VALUE", help=fault)
    add("--seed", type=SEED, default=1, metavar="N", help="seed of the faults [%(default)s]")
    add("--spin", action="store_true", help="arm a real STM32: its thrusters will turn")
    add(
        "--max-loss",
        type=Share(),
        default=0.0,
        metavar="SHARE",
        help="limit of commands without an answer [%(default)s]",
    )
    add("--max-errors", type=ERRORS, default=0, metavar="N", help="limit of damaged frames [%(default)s]")
    add(
        "--max-p99",
        metavar="TIME",
        type=LIMIT,
        help='limit of the round trip of 99 %% of the answered commands, such as "5 ms" [none]',
    )
    add_json(parser)
    return parser


def link_of(options: Any) -> Link:
    """Return the link that the options of hil.links.options.add_link, and --fault, describe. Raises ConfigError."""
    table = {key: getattr(options, key) for key in ("port", "protocol", "frame", "baud", "bitrate")}
    link = parse(table, Link, "command line")
    wanted = vars(options).get("fault")
    faults = parse(settings(wanted, "--fault"), Faults, "command line: --fault") if wanted else None
    return link._replace(options=settings(options.option, "--option"), faults=faults)


def _broken(result: Result, options: Any) -> list[str]:
    """Return the limits that were not met, in words."""
    broken = []
    if result.loss > options.max_loss:
        broken.append(f"loss {result.loss:.2%} is above {options.max_loss:.2%}")
    if result.errors > options.max_errors:
        broken.append(f"{result.errors} damaged frames are above {options.max_errors}")
    if options.max_p99 is not None:
        limit = options.max_p99 * 1e9 / NS_PER_MS
        if not result.p99_ms <= limit:
            broken.append(f"p99 {result.p99_ms:.2f} ms is above {limit:g} ms")
    return broken


def _record(result: Result, broken: list[str]) -> dict[str, Any]:
    record = result._asdict() | {"loss": result.loss, "errors": result.errors, "broken_limits": broken}
    return {key: None if value != value else value for key, value in record.items()}


def _text(result: Result, plan: Plan, broken: list[str]) -> str:
    out, back = result.bytes_per_second
    counters = result.counters
    wire = f", of which the wire takes {result.wire_ms:.2f} ms" if result.wire_ms == result.wire_ms else ""
    replaced = counters["replaced"]
    slow = (
        f"line slow   {replaced} commands were dropped in favour of newer ones; use a lower --rate" if replaced else ""
    )
    lines = [
        f"{plan.link.protocol} on {result.port}, {plan.stm32}, {plan.channels} thrusters, {result.seconds:.1f} s",
        f"commands    {result.sent} sent, {result.answered} answered, {result.lost} lost ({result.loss:.2%})",
        *([slow] if slow else []),
        f"received    {counters['messages_in']} messages, {counters['checksum_errors']} with a wrong checksum, "
        f"{counters['malformed']} malformed, {counters['dropped_bytes']} bytes dropped",
        f"throughput  {out:.0f} B/s out, {back:.0f} B/s in, {result.answered / result.seconds:.0f} round trips/s",
        f"round trip  p50 {result.p50_ms:.2f} ms, p99 {result.p99_ms:.2f} ms, max {result.max_ms:.2f} ms{wire}",
        *(f"LIMIT BROKEN: {text}" for text in broken),
    ]
    return "\n".join(lines)
