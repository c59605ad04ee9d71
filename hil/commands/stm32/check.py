"""`uuv-hil stm32 check`: turn each output a little and show its telemetry."""

import argparse
import json
import sys

from firmware_stub.image import CHIPS, load_image
from hil.bench.output_check import MAX_OFFSET_US, Finding, Plan, check_outputs
from hil.commands.loopback import link_of
from hil.common.errors import STOPPED, ConfigError
from hil.common.options import Number, Quantity, integer
from hil.common.stop import StopSignals
from hil.common.streams import agreed
from hil.links.contract import PWM_NEUTRAL_US
from hil.links.options import add_link
from hil.slave.drivers.driver import DRIVERS

FAILED = 1
OFFSET = integer(-MAX_OFFSET_US, MAX_OFFSET_US)
WARNING = """\
WARNING: every thruster will turn, one after the other, for {seconds:g} s each. Take the propellers off, or keep
everything and everybody away from them. Ctrl-C ends it with all outputs neutral."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the check."""
    add_link(parser, None)
    add = parser.add_argument
    add("--stm32", metavar="NAME", default="device", help="STM32 to check: device, or an emulated one [%(default)s]")
    add("--chip", choices=CHIPS, help="chip of the board, to name the pin of each output")
    add("--offset", metavar="US", type=OFFSET, default=60, help="offset of the pulse from 1500 us, us [%(default)s]")
    seconds = Number(0.1, 5.0, "s")
    add("--seconds", metavar="S", type=seconds, default=1.0, help="time that each output turns, s [%(default)s]")
    settle = Quantity(0.0, 30.0, "s")
    add("--settle", metavar="TIME", type=settle, default="2 s", help="neutral before the first output [%(default)s]")
    add("--yes", action="store_true", help="do not ask: the propellers are free")
    add("--json", action="store_true", help="print JSON, for other programs")


def run(options: argparse.Namespace) -> int:
    """Check; return 0 if every output answered, 1 if not, 130 after Ctrl-C. Raises HilError."""
    plan = Plan(_kind(options), link_of(options), options.channels, options.offset, options.seconds, options.settle)
    pins = load_image(options.chip).outputs if options.chip else ()
    print(WARNING.format(seconds=options.seconds), file=sys.stderr)
    if not options.yes and not agreed("turn them?", "if the propellers are free, give --yes"):
        return FAILED

    def show(finding: Finding) -> None:
        if not options.json:
            print(text(finding, pins), flush=True)

    with StopSignals() as stop_fd:
        findings = check_outputs(plan, stop_fd, lambda line: print(line, file=sys.stderr, flush=True), show)
    if findings is None:
        return STOPPED
    good = sum(finding.passed for finding in findings)
    if options.json:
        print(json.dumps([finding._asdict() | {"passed": finding.passed} for finding in findings], indent=2))
    else:
        print(
            f"{good} of {len(findings)} outputs confirmed by telemetry; check by eye whether they turned, and which way"
        )
    return 0 if good == len(findings) else FAILED


def _kind(options: argparse.Namespace) -> str:
    if options.stm32 not in DRIVERS:
        raise ConfigError(f"--stm32: {options.stm32!r} is not one of {', '.join(DRIVERS)}")
    if options.offset == 0:
        raise ConfigError("--offset: 0 turns nothing; -150 to 150 us")
    if options.stm32 == "device" and not options.port:
        raise ConfigError("no device: name it with --port, such as --port /dev/ttyUSB0 or can:socketcan:can0")
    if not options.port:
        options.port = "pty:"
    return str(options.stm32)


def text(finding: Finding, pins: tuple[str, ...]) -> str:
    """Return one line on the telemetry of an output."""
    pin = f" ({pins[finding.output - 1]})" if finding.output <= len(pins) else ""
    name = f"output {finding.output}{pin}"
    if finding.confirmed_ms is not None:
        text = f"{finding.pulse_us} us confirmed after {finding.confirmed_ms:.1f} ms"
    elif finding.reported_us is None:
        text = "NOT CONFIRMED: no telemetry while it was to turn"
    elif finding.reported_us == PWM_NEUTRAL_US:
        text = f"NOT CONFIRMED: telemetry shows neutral instead of {finding.pulse_us} us"
    else:
        text = f"NOT CONFIRMED: telemetry shows {finding.reported_us} us instead of {finding.pulse_us} us"
    if finding.motor:
        text += "; " + ", ".join(f"{value:g} {unit}" for unit, value in finding.motor.items())
    if finding.others:
        text += f"; WRONG: telemetry shows that output {', '.join(map(str, finding.others))} turned as well"
    return f"  {name}: {text}"
