"""Common option parser of every subcommand, and typed converters that check option values.

A numeric option has a `Number`, `Share` or `List` as its argparse type, with the permitted range. An invalid or unknown
value ends the command with one line (ConfigError, exit code 2) that names the option, the value and what is permitted,
with the nearest valid word if there is one.
"""

import argparse
import math
import re
import sys
from collections.abc import Callable
from typing import Any, NoReturn

from hil.common.endpoint import LAN, full_endpoint
from hil.common.errors import EXIT_CODES, ConfigError, HilError
from hil.common.schema import nearest, shortened
from hil.common.tables import output_file, settings
from hil.common.units import UNITS, split_unit, with_unit

UNKNOWN = "unrecognized arguments: "  # start of argparse's message about unknown words and options
LOCAL_SLAVE = "tcp/127.0.0.1:7447"  # default endpoint of a slave on this machine
MAX_SEEDS = 100_000
MAX_JOBS = 1024
DAY_S = 86_400.0
YEAR_S = 366.0 * DAY_S
HOST = re.compile(r"(?=.{1,253}\Z)[A-Za-z0-9_]([A-Za-z0-9_-]{0,62})(\.[A-Za-z0-9_][A-Za-z0-9_-]{0,62})*\.?\Z")


class Parser(argparse.ArgumentParser):
    """An argument parser that raises a ConfigError of one line, where argparse prints its usage and exits.

    Its help ends with the exit codes, and so does the help of its subcommands. A subcommand's help contains those
    examples of the command that use it.
    """

    def __init__(self, *args: Any, **settings: Any) -> None:
        super().__init__(*args, **settings)
        self.register("action", "parsers", _Subcommands)

    def add_subparsers(self, **settings: Any) -> Any:
        """Return the group of subcommands, which gets this parser's examples."""
        group: Any = super().add_subparsers(**settings)
        group.examples = self.epilog or ""
        return group

    def _get_formatter(self) -> argparse.HelpFormatter:
        from hil.common.columns import HelpFormatter  # only where help is asked for

        self.formatter_class = HelpFormatter
        return super()._get_formatter()

    def format_help(self) -> str:
        """Return argparse's help, followed by the exit codes."""
        formatter = self._get_formatter()
        formatter.add_text(EXIT_CODES)
        return f"{super().format_help().rstrip()}\n\n{formatter.format_help()}"

    def error(self, message: str) -> NoReturn:
        """Raise ConfigError with the message and a hint to --help."""
        about, unknown, words = message.partition(UNKNOWN)
        raise ConfigError(
            f"{self._unknown(words) if unknown and not about else message.removeprefix('argument ')}; "
            f"see {self.prog} --help"
        )

    def _print_message(self, message: str, file: Any = None) -> None:
        """Print a message; unlike argparse, raise OSError on a full disk."""
        (file or sys.stdout).write(message)

    def _unknown(self, words: str) -> str:
        known = [name for parser in (self, *subparsers(self).values()) for name in parser._option_string_actions]
        first = words.split(" ", maxsplit=1)[0]
        if first.startswith("-"):
            name = first.partition("=")[0]  # suggest neither this same name, of another subcommand, nor a short option
            meant = nearest(name, [one for one in known if one.startswith("--") and one != name])
            return f"no option {shortened(first)}{meant if name.startswith('--') else ''}"
        return f"too many words: {shortened(words)}"

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse a value that is not one of the choices, and suggest the nearest one."""
        if action.choices is not None and value not in action.choices:
            choices = [str(choice) for choice in action.choices]
            words = f"{shortened(str(value))} is not one of {', '.join(choices)}{nearest(str(value), choices)}"
            raise argparse.ArgumentError(action, words)


class _Subcommands(argparse._SubParsersAction):  # type: ignore[type-arg] # no generic at run time
    """The subcommands of a parser. The help of each one describes it and shows its examples."""

    examples = ""

    def add_parser(self, name: str, **settings: Any) -> Parser:
        """Return the parser of one subcommand; `help` describes it in a few words."""
        about = settings["help"]
        shows_it = re.compile(rf"\s.*{re.escape(self._prog_prefix)} {re.escape(name)}\b")
        shown = [line for line in self.examples.splitlines() if shows_it.match(line)]
        epilog = "\n".join(["examples:", *shown]) if shown else None
        own = {"description": f"{about[0].upper()}{about[1:]}.", "epilog": epilog}
        parser: Parser = super().add_parser(name, **(own | settings))
        return parser


def new_parser(name: str, description: str | None, examples: str) -> Parser:
    """Return a parser for `uuv-hil NAME`; its --help ends with the text `examples`."""
    return Parser(
        prog=f"uuv-hil {name}",
        description=description,
        epilog=examples,
    )


def add_scenario(
    parser: argparse.ArgumentParser, default: str | None = "paper_field", *, optional: bool = False
) -> None:
    """Add SCENARIO, the scenario to run, and --set. Without a default it is required unless `optional`."""
    add_scenario_name(parser, default, optional=optional)
    add_changes(parser)


def add_scenario_name(
    parser: argparse.ArgumentParser, default: str | None = None, *, optional: bool = False, of: str = ""
) -> None:
    """Add SCENARIO alone; `of` begins its help. Without a default it is required unless `optional`."""
    usual = f" [{default}]" if default else ""
    parser.add_argument(
        "scenario", metavar="SCENARIO", nargs="?" if default or optional else None, default=default,
        help=f"{of}a .toml file, or the name of an installed scenario{usual}",
    )  # fmt: skip


def add_output(parser: argparse.ArgumentParser, metavar: str, about: str, *, required: bool = False) -> None:
    """Add -o and --output, the file or folder that the command writes; a missing folder is created."""
    add = add_file if metavar.startswith("FILE.") else argparse.ArgumentParser.add_argument
    add(parser, "-o", "--output", metavar=metavar, help=about, required=required)


def add_file(parser: argparse.ArgumentParser, *names: str, help: str, **settings: Any) -> None:  # noqa: A002
    """Add an option of these `names` for a file that the command writes; return its folder has to exist."""
    parser.add_argument(*names, type=OUTPUT_FILE, help=f"{help}; its folder must be there", **settings)


def _adder(name: str, about: str, **settings: Any) -> Callable[..., None]:
    """Return a function that adds one option to a parser, with `about` or another help."""

    def add(parser: argparse._ActionsContainer, about: str = about) -> None:
        parser.add_argument(name, help=about, **settings)

    return add


def add_plot(parser: argparse.ArgumentParser, about: str) -> None:
    """Add --plot, the picture that the command draws."""
    add_file(parser, "--plot", metavar="FILE.png", help=about)


def add_serving(parser: argparse.ArgumentParser, default: str) -> None:
    """Add --listen, the address of a server other than a slave, parsed by `serving_address`."""
    about = "address to listen on [%(default)s]"
    parser.add_argument("--listen", metavar="[HOST:]PORT", type=serving_address, default=default, help=about)


def changes_of(options: Any) -> dict[str, Any]:
    """Return the changes of `add_changes` by dotted key, for `load_scenario`. Raises ConfigError."""
    return settings(options.set, "--set")


def scenario_words(options: Any) -> list[str]:
    """Return the words that name the scenario and its changes, for the command of a child process."""
    return [options.scenario, *[word for text in options.set for word in ("--set", text)]]


def subparsers(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Return the parsers of a parser's subcommands, by name."""
    groups = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    return {name: inner for group in groups for name, inner in group.choices.items()}


class Number:
    """An argparse type: a number in [low, high], or one of the values in `also`.

    With a `unit` of hil.common.units.UNITS, text with a unit is allowed too, such as "200 ms". Returns an int if
    `integer`. Values in `also` may lie outside the range. Refuses nan and inf.
    """

    def __init__(
        self, low: float, high: float, unit: str = "", *, integer: bool = False, also: tuple[float, ...] = ()
    ) -> None:
        self.low, self.high, self.unit, self.integer, self.also = low, high, unit, integer, also

    def __call__(self, text: str) -> Any:
        """Return the number in `text`. Raises argparse.ArgumentTypeError, to which argparse adds the option."""
        value = self._value(text.strip())
        if value is None or not (self.low <= value <= self.high or value in self.also):  # also refuses nan
            raise argparse.ArgumentTypeError(f"expected {self.permitted}, found {shortened(text)}")
        return value

    def _value(self, text: str) -> float | None:
        try:
            if self.integer:
                return int(text)
            value = with_unit(text, self.unit, "") if split_unit(text)[1] and self.unit in UNITS else float(text)
        except (ValueError, ConfigError):  # ValueError also for more digits than Python reads
            return None
        return value if math.isfinite(value) else None

    @property
    def permitted(self) -> str:
        """Text that describes the permitted values."""
        unit = f" {self.unit}" if self.unit else ""
        words = f"a {'whole ' * self.integer}number from {_plain(self.low)} to {_plain(self.high)}{unit}"
        return ", or ".join([words, *map(_plain, self.also)])


class Quantity(Number):
    """An argparse type: a number in [low, high] of `unit`, always written with a unit, such as "5 ms"."""

    def _value(self, text: str) -> float | None:
        return super()._value(text) if split_unit(text)[1] else None

    @property
    def permitted(self) -> str:
        """Text that describes the permitted values."""
        return f"{super().permitted}, with its unit"


class Share(Number):
    """An argparse type: a share from 0 to 1, 0.05 or "5%"."""

    def __init__(self) -> None:
        super().__init__(0.0, 1.0)

    def _value(self, text: str) -> float | None:
        value = super()._value(text.removesuffix("%"))
        return value / 100.0 if value is not None and text.endswith("%") else value

    @property
    def permitted(self) -> str:
        """Text that describes the permitted values."""
        return f'a share from {self.low:.0%} to {self.high:.0%}, such as 0.05 or "5%"'


class List:
    """An argparse type: up to `most` values of one kind, separated by commas, as a tuple without duplicates."""

    def __init__(self, item: Callable[[str], Any], most: int = 100) -> None:
        self.item, self.most = item, most

    def __call__(self, text: str) -> tuple[Any, ...]:
        """Return the values in `text`. Raises argparse.ArgumentTypeError."""
        words = text.split(",")
        if len(words) > self.most:
            raise argparse.ArgumentTypeError(f"expected at most {self.most} values, found {len(words)}")
        return tuple(dict.fromkeys(self.item(word) for word in words))


def integer(low: int, high: int, *, also: tuple[int, ...] = (), unit: str = "") -> Number:
    """Return the type of a whole number from `low` to `high`."""
    return Number(low, high, unit, integer=True, also=also)


PORT = integer(0, 65_535)  # 0: any free port
SEED = integer(0, 2**63 - 1)
SEEDS = integer(1, MAX_SEEDS)
JOBS = integer(1, MAX_JOBS, also=(-1,))  # -1: all cores
REPEAT = integer(1, 1000)
DESCRIPTOR = integer(0, 65_535)
LATITUDE = Number(-90.0, 90.0, "degrees")
LONGITUDE = Number(-180.0, 180.0, "degrees")
WAIT = Number(0.0, DAY_S, "s")  # time to wait for a peer; 0: do not wait
BAUD = integer(1200, 12_000_000)
BITRATE = integer(10_000, 1_000_000)


def one_of(*names: str) -> Callable[[str], str]:
    """Return a type for one word of `names`, as the item type of a List."""

    def choose(text: str) -> str:
        if text not in names:
            raise argparse.ArgumentTypeError(
                f"expected {' or '.join(names)}, found {shortened(text)}{nearest(text, [*names])}"
            )
        return text

    return choose


def checked(convert: Callable[[str], Any]) -> Callable[[str], Any]:
    """Return an argparse type from `convert`; it turns HilError into an error to which argparse adds the option."""

    def call(text: str) -> Any:
        try:
            return convert(text)
        except HilError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return call


OUTPUT_FILE = checked(output_file)
ENDPOINT = checked(full_endpoint)  # tcp/HOST:PORT, HOST:PORT or HOST; returns tcp/HOST:PORT

add_json = _adder("--json", "print JSON, for other programs", action="store_true")
add_strict = _adder("--strict", "exit with 1 for a problem and for a warning", action="store_true")
add_view = _adder("--view", "show it in a browser while it flies", action="store_true")
add_board = _adder("--board", "the single-board computer this is [recognised]", metavar="NAME")
add_member = _adder("--member", "vehicle of the fleet, by name or number", metavar="NAME", default="")
add_listen = _adder(
    "--listen", "endpoint that masters connect to, tcp/ADDRESS:PORT [the scenario's]", metavar="ENDPOINT", type=ENDPOINT
)
add_changes = _adder(  # which `changes_of` returns
    "--set", 'change a key of the scenario, such as "master.speed=0.5"; may be given several times',
    action="append", default=[], metavar="KEY=VALUE",
)  # fmt: skip


def endpoint_or_lan(text: str) -> str:
    """Return the endpoint in `text`, or "lan": search by multicast."""
    return text if text == LAN else str(ENDPOINT(text))


def host(text: str) -> str:
    """Return the name or address of a machine; an IPv6 address without its brackets."""
    from ipaddress import ip_address

    plain = text[1:-1] if text.startswith("[") and text.endswith("]") else text
    try:
        return str(ip_address(plain))
    except ValueError:
        pass
    if not HOST.match(text) or re.fullmatch(r"[0-9.]+", text):
        raise argparse.ArgumentTypeError(f"expected the name or address of a machine, found {shortened(text)}")
    return text


def serving_address(text: str) -> tuple[str, int]:
    """Return host and port of [HOST:]PORT, the address of a server; without a host only this machine can connect."""
    name, _, port = text.rpartition(":")
    try:
        return host(name) if name else "127.0.0.1", PORT(port)
    except argparse.ArgumentTypeError:
        words = (
            f"expected [HOST:]PORT, such as 9747 or 0.0.0.0:9747, with a port from 0 to 65535, found {shortened(text)}"
        )
        raise argparse.ArgumentTypeError(words) from None


def lat_lon(text: str) -> tuple[float, float]:
    """Return latitude and longitude (degrees) of LAT,LON."""
    words = text.split(",")
    if len(words) != 2:
        raise argparse.ArgumentTypeError(
            f"expected LAT,LON in degrees, such as 59.603,-151.412, found {shortened(text)}"
        )
    return LATITUDE(words[0]), LONGITUDE(words[1])


def _plain(value: float) -> str:
    """Return a number as text, without an exponent if it is short enough."""
    return f"{value:.0f}" if float(value).is_integer() and abs(value) < 1e9 else f"{value:g}"
