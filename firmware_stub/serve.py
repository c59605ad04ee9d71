"""`uuv-hil stm32`: run the STM32 as a separate process, for software that expects one on its link."""

import argparse
import select
import sys
from collections.abc import Callable

from firmware_stub.stub import Stm32, Stm32End
from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import ConfigError, HilError
from hil.common.lifeline import die_with_parent
from hil.common.options import Quantity, new_parser
from hil.common.stop import StopSignals
from hil.common.tables import settings
from hil.links.address import incompatibility, open_address
from hil.links.contract import ThrusterLink
from hil.links.options import add_link
from hil.links.protocols import open_protocol
from hil.links.wires.suspension import SuspendableWire

NAME = "uuv-hil stm32"
WATCHDOG = Quantity(0.01, 60.0, "s")
REPORT_PERIOD_NS = 5 * NS_PER_S
EXAMPLES = """\
examples:
  uuv-hil stm32                                     a pty; open /tmp/uuv-hil-stm32 as your serial port
  uuv-hil stm32 --channels 8 --watchdog "500 ms"    eight thrusters, a longer watchdog
  uuv-hil stm32 --port /dev/ttyUSB0 --baud 921600   at the far end of a real cable
  uuv-hil stm32 --frame my_lab.toml                 another lab's frame (see firmware_stub/frames/uuv_hil.toml)
  uuv-hil stm32 --protocol mavlink --port udp://127.0.0.1:14550
  uuv-hil stm32 --protocol dronecan --port can:socketcan:can0 --option node_id=25
"""


def main(argv: list[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM; return the exit code. `argv` is without the command's name."""
    die_with_parent()
    try:
        parser = new_parser("stm32", __doc__, EXAMPLES)
        add_options(parser)
        start(parser.parse_args(argv))
    except HilError as error:
        print(f"{NAME}: {error}", file=sys.stderr)
        return error.exit_code
    return 0


def start(options: argparse.Namespace) -> None:
    """Run with these values of `add_options` until SIGINT or SIGTERM. Raises HilError."""
    problem = incompatibility(options.protocol, options.port)
    if problem:
        raise ConfigError(f"command line: {problem}")
    with StopSignals() as stop_fd:
        _run(options, stop_fd)


def serve(end: Stm32End, stop_fd: int, report: Callable[[Stm32End], None] | None = None) -> None:
    """Run the STM32 until `stop_fd` becomes readable, then put its outputs to neutral and close it.

    `report` is called every 5 s. Raises DeviceError when the wire is lost.
    """
    report_ns = now_ns() + REPORT_PERIOD_NS
    try:
        while True:
            now = now_ns()
            end.service(now)
            if report and now >= report_ns:
                report(end)
                report_ns = now + REPORT_PERIOD_NS
            due_ns = min(end.deadline_ns, report_ns) if report else end.deadline_ns
            wait_ns = max(0, due_ns - now_ns())
            if stop_fd in select.select((end.fileno(), stop_fd), (), (), wait_ns / NS_PER_S)[0]:
                return
    finally:
        end.close()


def _run(options: argparse.Namespace, stop_fd: int) -> None:
    chosen = settings(options.option, "option:")
    if options.protocol == "frame":
        chosen["frame"] = options.frame
    protocol = open_protocol(options.protocol, "device", options.channels, **chosen)
    stm32 = Stm32(options.channels, round(options.watchdog * NS_PER_S))
    opened = open_address(options.port, "device", options.baud, options.bitrate)
    wire = SuspendableWire(opened, stm32.watchdog_ns, protocol.counters)
    protocol_text = f"frame {options.frame}" if options.protocol == "frame" else options.protocol
    _print_line(
        f"STM32 with {options.channels} thrusters on {wire.name}: {protocol_text}, "
        f"watchdog {options.watchdog * 1e3:g} ms; Ctrl-C ends it"
    )
    end = Stm32End(stm32, ThrusterLink(wire, protocol))
    serve(end, stop_fd, None if options.quiet else lambda end: _print_line(_status(end)))
    _print_line("stopped: " + _status(end))


def _status(end: Stm32End) -> str:
    stm32, counters = end.stm32, end.link.counters
    state = "armed" if stm32.armed else "timed out" if stm32.timed_out else "disarmed"
    return (
        f"{stm32.frames} commands, {stm32.refused} refused, {counters.checksum_errors} checksum errors, "
        f"{counters.malformed} malformed, {counters.dropped_bytes} bytes dropped (noise, or no reader), "
        f"{stm32.watchdog_trips} watchdog trips; {state}, pwm {' '.join(map(str, stm32.pwm_us))}"
    )


def _print_line(line: str) -> None:
    print(line, flush=True)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add all options of an emulated STM32."""
    add_link(parser, "pty:/tmp/uuv-hil-stm32")
    add = parser.add_argument
    add(
        "--watchdog",
        metavar="S",
        type=WATCHDOG,
        default="200 ms",
        help="longest time without a command before all thrusters stop [%(default)s]",
    )
    add("--quiet", action="store_true", help="print nothing between start and end")


if __name__ == "__main__":
    sys.exit(main())
