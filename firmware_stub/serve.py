"""`uuv-hil stm32`: the STM32 in a process of its own, for software that expects one on a serial port."""

import argparse
import select
import sys
from collections.abc import Callable
from typing import Annotated, NamedTuple

from firmware_stub.stub import Stm32, Stm32End
from hil.clock import NS_PER_S, now_ns
from hil.errors import ConfigError, HilError
from hil.links.contract import MAX_THRUSTERS, ThrusterLink
from hil.links.frame import FrameProtocol
from hil.links.wires import open_wire
from hil.schema import Range, find_preset, parse
from hil.stop import StopSignals

NAME = "uuv-hil stm32"
REPORT_PERIOD_NS = 5 * NS_PER_S
EXAMPLES = """\
examples:
  uuv-hil stm32                                     a pty; open /tmp/uuv-hil-stm32 as your serial port
  uuv-hil stm32 --channels 8 --watchdog "500 ms"    eight thrusters, a patient watchdog
  uuv-hil stm32 --uart /dev/ttyUSB0 --baud 921600   at the far end of a real cable
  uuv-hil stm32 --frame my_lab.toml                 another lab's frame (see firmware_stub/frames/uuv_hil.toml)
"""


class Options(NamedTuple):
    """What the command line may say, checked like any file."""

    device: str
    uart: str
    baud: Annotated[int, Range(1200, 12_000_000, "bit/s")]
    channels: Annotated[int, Range(1, MAX_THRUSTERS)]
    watchdog: Annotated[float, Range(0.01, 60.0, "s")]
    frame: str


def main(argv: list[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM; the exit code. `argv` is without the command's name."""
    try:
        options = parse(vars(_parser().parse_args(argv)), Options, "command line")
        with StopSignals() as stop_fd:
            _run(options, stop_fd)
    except HilError as error:
        print(f"{NAME}: {error}", file=sys.stderr)
        return error.exit_code
    return 0


def serve(end: Stm32End, stop_fd: int, report: Callable[[Stm32End], None] | None = None) -> None:
    """Be the STM32 until `stop_fd` becomes readable, then put its outputs to neutral and close it.

    `report` is called every 5 s. Raises DeviceError when the wire is gone.
    """
    report_ns = now_ns() + REPORT_PERIOD_NS
    try:
        while True:
            now = now_ns()
            end.service(now)
            if report and now >= report_ns:
                report(end)
                report_ns = now + REPORT_PERIOD_NS
            wait_ns = max(0, min(end.deadline_ns, report_ns) - now_ns())
            if stop_fd in select.select((end.fileno(), stop_fd), (), (), wait_ns / NS_PER_S)[0]:
                return
    finally:
        end.close()


def _run(options: Options, stop_fd: int) -> None:
    protocol = FrameProtocol(find_preset("firmware_stub/frames", options.frame))
    if options.channels not in protocol.channels:
        carried = " to ".join(map(str, sorted({protocol.channels[0], protocol.channels[-1]})))
        raise ConfigError(f"command line: channels: frame {options.frame} carries {carried}, not {options.channels}")
    if options.uart:
        wire = open_wire("uart", device=options.uart, baud=options.baud)
    else:
        wire = open_wire("pty", link_path=options.device)
    stm32 = Stm32(options.channels, round(options.watchdog * NS_PER_S))
    _say(
        f"STM32 with {options.channels} thrusters on {wire.name}: frame {options.frame}, "
        f"watchdog {options.watchdog * 1e3:g} ms; Ctrl-C ends it"
    )
    end = Stm32End(stm32, ThrusterLink(wire, protocol))
    serve(end, stop_fd, lambda end: _say(_status(end)))
    _say("stopped: " + _status(end))


def _status(end: Stm32End) -> str:
    stm32, counters = end.stm32, end.link.counters
    state = "armed" if stm32.armed else "timed out" if stm32.timed_out else "disarmed"
    return (
        f"{stm32.frames} commands, {stm32.refused} refused, {counters.checksum_errors} checksum errors, "
        f"{counters.malformed} malformed, {counters.dropped_bytes} bytes dropped (noise, or nobody reads), "
        f"{stm32.watchdog_trips} watchdog trips; {state}, pwm {' '.join(map(str, stm32.pwm_us))}"
    )


def _say(line: str) -> None:
    print(line, flush=True)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=NAME,
        description=__doc__,
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--device", default="/tmp/uuv-hil-stm32", help="path of the pty to make [%(default)s]")
    where.add_argument("--uart", default="", metavar="PATH", help="a serial device to use instead of a pty")
    add("--baud", type=int, default=115_200, help="speed of the uart, bit/s [%(default)s]")
    add("--channels", type=int, default=6, help="number of thrusters, 1 to 16 [%(default)s]")
    add("--watchdog", default="200 ms", help="longest silence before all thrusters stop [%(default)s]")
    add("--frame", default="uuv_hil", help="name of a frame, or path of a frame's TOML file [%(default)s]")
    return parser


if __name__ == "__main__":
    sys.exit(main())
