"""`uuv-hil stm32`: emulate the STM32 alone, on a pty or a serial port; flash a real one, and check its outputs."""

from firmware_stub import serve
from hil.commands.stm32 import check, flash
from hil.common.errors import ConfigError
from hil.common.options import new_parser

EXAMPLES = f"""\
Without a subcommand it emulates an STM32, for software that expects one on its link. flash and check have run with
emulated probes and chips only, never yet on hardware.

{serve.EXAMPLES}\
  uuv-hil stm32 flash --dry-run --chip f411         show what would be written, and the wiring
  uuv-hil stm32 flash                               recognise the board and write its image, by a debug probe
  uuv-hil stm32 flash --by dfu --chip f411          the same by USB, after BOOT0 and reset
  uuv-hil stm32 check --port /dev/ttyUSB0           turn each output a little; propellers off first
  uuv-hil stm32 check --stm32 unicorn --yes         the same with an emulated STM32
"""


def main(arguments: list[str]) -> int:
    """Emulate, flash or check; return the exit code. Raises HilError."""
    parser = new_parser("stm32", __doc__, EXAMPLES)
    serve.add_options(parser)
    actions = parser.add_subparsers(dest="action", metavar="SUBCOMMAND", required=False)
    flash.add_options(
        actions.add_parser(
            "flash",
            help="write the firmware's image to a board, by a debug probe or by USB (DFU)",
            description="Recognise the board, print its wiring, and write the firmware's image by a debug probe "
            "(pyOCD) or by USB (dfu-util). Tried with emulated chips and probes only, never yet on hardware.",
        )
    )
    check.add_options(
        actions.add_parser(
            "check",
            help="turn each output a little, one after the other, and show its telemetry",
            description="Turn each output a little, one after the other, and show its telemetry. Propellers "
            "must be free: it asks first. Tried with emulated STM32 only, never yet on hardware.",
        )
    )
    options = parser.parse_args(arguments)
    if options.action and arguments[0] != options.action:
        raise ConfigError(f"{arguments[0]}: options of {options.action} come after it: stm32 {options.action} ...")
    if options.action == "flash":
        return flash.run(options)
    if options.action == "check":
        return check.run(options)
    serve.start(options)
    return 0
