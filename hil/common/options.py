"""Common option parser of every subcommand, and typed converters that check its values.

An option that takes a number has a `Number`, `Share` or `List` as its argparse type, each with the range that is
permitted. What is mistyped, out of range or not known ends with one line that names the option, what was typed and
what is permitted (ConfigError, exit code 2), with the nearest right word where there is one.
"""

import argparse
import math
import re
import sys
from collections.abc import Callable
from typing import Any, NoReturn

from hil.common.endpoint import full_endpoint
from hil.common.errors import EXIT_CODES, ConfigError, HilError
from hil.common.schema import UNITS, nearest, shortened, with_unit
from hil.common.tables import output_file, settings

UNKNOWN = "unrecognized arguments: "  # how argparse begins its message on words and options that it does not know
LOCAL_SLAVE = "tcp/127.0.0.1:7447"  # where a slave of this machine listens, unless its scenario has another address
MOST_SEEDS = 100_000
MOST_JOBS = 1024
DAY_S = 86_400.0
YEAR_S = 366.0 * DAY_S
HOST = re.compile(r"(?=.{1,253}\Z)[A-Za-z0-9_]([A-Za-z0-9_-]{0,62})(\.[A-Za-z0-9_][A-Za-z0-9_-]{0,62})*\.?\Z")


class Parser(argparse.ArgumentParser):
    """An argument parser that raises ConfigError, one line, where argparse prints its usage and exits.

    Its help, and that of its subcommands, ends with the exit codes. A subcommand's help has those of the command's
    examples that show it.
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
        """Return the help: what argparse makes of the options, then what each exit code means."""
        formatter = self._get_formatter()
        formatter.add_text(EXIT_CODES)
        return f"{super().format_help().rstrip()}\n\n{formatter.format_help()}"

    def error(self, message: str) -> NoReturn:
        """Raise ConfigError with the message, and where to read more."""
        about, unknown, words = message.partition(UNKNOWN)
        raise ConfigError(
            f"{self._unknown(words) if unknown and not about else message.removeprefix('argument ')}; "
            f"see {self.prog} --help"
        )

    def _print_message(self, message: str, file: Any = None) -> None:
        """Print, and raise on a full disk, which argparse ignores."""
        (file or sys.stdout).write(message)

    def _unknown(self, words: str) -> str:
        known = [name for parser in (self, *subparsers(self).values()) for name in parser._option_string_actions]
        first = words.split(" ", maxsplit=1)[0]
        if first.startswith("-"):
            name = first.partition("=")[0]  # one that another subcommand has is not what was meant, nor any one letter
            meant = nearest(name, [one for one in known if one.startswith("--") and one != name])
            return f"no option {shortened(first)}{meant if name.startswith('--') else ''}"
        return f"too many words: {shortened(words)}"

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse a choice that is none, with the nearest that is one."""
        if action.choices is not None and value not in action.choices:
            choices = [str(choice) for choice in action.choices]
            words = f"{shortened(str(value))} is not one of {', '.join(choices)}{nearest(str(value), choices)}"
            raise argparse.ArgumentError(action, words)


class _Subcommands(argparse._SubParsersAction):  # type: ignore[type-arg] # no generic at run time
    """The subcommands of a parser. Each one's own help states what it does, and shows its examples."""

    examples = ""

    def add_parser(self, name: str, **settings: Any) -> Parser:
        """Return the parser of one subcommand; `help` is what it does, in a few words."""
        about = settings["help"]
        shows_it = re.compile(rf"\s.*{re.escape(self._prog_prefix)} {re.escape(name)}\b")
        shown = [line for line in self.examples.splitlines() if shows_it.match(line)]
        epilog = "\n".join(["examples:", *shown]) if shown else None
        own = {"description": f"{about[0].upper()}{about[1:]}.", "epilog": epilog}
        parser: Parser = super().add_parser(name, **(own | settings))
        return parser


def new_parser(name: str, description: str | None, examples: str) -> Parser:
    """Return a parser for `uuv-hil NAME` whose --help ends with `examples` as they stand."""
    return Parser(
        prog=f"uuv-hil {name}",
        description=description,
        epilog=examples,
    )


def add_scenario(
    parser: argparse.ArgumentParser, default: str | None = "paper_field", *, optional: bool = False
) -> None:
    """Add SCENARIO, which the command flies or runs, and --set. Without a default it is required unless `optional`."""
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
    """Add -o and --output, the file that the command writes, or the folder, which it makes."""
    add = add_file if metavar.startswith("FILE.") else argparse.ArgumentParser.add_argument
    add(parser, "-o", "--output", metavar=metavar, help=about, required=required)


def add_file(parser: argparse.ArgumentParser, *names: str, help: str, **settings: Any) -> None:  # noqa: A002
    """Add an option of these `names`: a file that the command writes, in a folder that is there."""
    parser.add_argument(*names, type=OUTPUT_FILE, help=f"{help}; its folder must be there", **settings)


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add --json, which prints one JSON value in place of text."""
    parser.add_argument("--json", action="store_true", help="print JSON, for other programs")


def add_plot(parser: argparse.ArgumentParser, about: str) -> None:
    """Add --plot, the picture that the command draws."""
    add_file(parser, "--plot", metavar="FILE.png", help=about)


def add_listen(parser: argparse.ArgumentParser, of: str = "") -> None:
    """Add --listen, where a slave listens; `of` names the actions that read it."""
    about = f"{of}endpoint that masters connect to, tcp/ADDRESS:PORT [the scenario's]"
    parser.add_argument("--listen", metavar="ENDPOINT", type=ENDPOINT, help=about)


def add_serving(parser: argparse.ArgumentParser, default: str) -> None:
    """Add --listen, where something other than a slave is served; `serving_address` reads it."""
    about = "address to listen on [%(default)s]"
    parser.add_argument("--listen", metavar="[HOST:]PORT", type=serving_address, default=default, help=about)


def add_view(parser: argparse.ArgumentParser, about: str = "show it in a browser while it flies") -> None:
    """Add --view, which shows what the command does in the live view."""
    parser.add_argument("--view", action="store_true", help=about)


def add_board(parser: argparse.ArgumentParser, of: str = "") -> None:
    """Add --board, the single-board computer; `of` names the actions that read it."""
    parser.add_argument("--board", metavar="NAME", help=f"{of}the single-board computer this is [recognised]")


def add_member(parser: argparse.ArgumentParser, of: str = "") -> None:
    """Add --member, one vehicle of a fleet; `of` names the actions that read it."""
    parser.add_argument("--member", metavar="NAME", default="", help=f"{of}vehicle of the fleet, by name or number")


def add_changes(parser: argparse.ArgumentParser) -> None:
    """Add --set, which changes keys of the scenario; `changes_of` reads it."""
    change = 'change a key of the scenario, such as "master.speed=0.5"; may be given several times'
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help=change)


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

    With a `unit` of hil.common.schema.UNITS also text with its unit, such as "200 ms". Returns an int if
    `whole`. `low` may be left out of the range (`above`). Refuses what is not finite.
    """

    def __init__(
        self, low: float, high: float, unit: str = "", *, whole: bool = False, also: tuple[float, ...] = ()
    ) -> None:
        self.low, self.high, self.unit, self.whole, self.also = low, high, unit, whole, also

    def __call__(self, text: str) -> Any:
        """Return the number in `text`. Raises argparse.ArgumentTypeError, which argparse completes by the option."""
        value = self._value(text.strip())
        if value is None or not (self.low <= value <= self.high or value in self.also):  # also refuses nan
            raise argparse.ArgumentTypeError(f"expected {self.permitted}, found {shortened(text)}")
        return value

    def _value(self, text: str) -> float | None:
        try:
            if self.whole:
                return int(text)
            value = with_unit(text, self.unit, "") if " " in text and self.unit in UNITS else float(text)
        except (ValueError, ConfigError):  # also a whole number of more digits than Python reads
            return None
        return value if math.isfinite(value) else None

    @property
    def permitted(self) -> str:
        """Text that describes the permitted values."""
        unit = f" {self.unit}" if self.unit else ""
        words = f"a {'whole ' * self.whole}number from {_plain(self.low)} to {_plain(self.high)}{unit}"
        return ", or ".join([words, *map(_plain, self.also)])


class Quantity(Number):
    """An argparse type: a number in [low, high] of `unit`, always written with a unit, such as "5 ms"."""

    def _value(self, text: str) -> float | None:
        return super()._value(text) if " " in text else None

    @property
    def permitted(self) -> str:
        """Text that describes the permitted values."""
        return f"{super().permitted}, with its unit after a space"


class Share(Number):
    """An argparse type: a share from `low` to `high`, 0.05 or "5%"."""

    def __init__(self, low: float = 0.0, high: float = 1.0) -> None:
        super().__init__(low, high)

    def _value(self, text: str) -> float | None:
        value = super()._value(text.removesuffix("%"))
        return value / 100.0 if value is not None and text.endswith("%") else value

    @property
    def permitted(self) -> str:
        """Text that describes the permitted values."""
        return f'a share from {self.low:.0%} to {self.high:.0%}, such as 0.05 or "5%"'


class List:
    """An argparse type: values of one kind with commas between, at most `most` of them, as a tuple."""

    def __init__(self, item: Callable[[str], Any], most: int = 100) -> None:
        self.item, self.most = item, most

    def __call__(self, text: str) -> tuple[Any, ...]:
        """Return the values in `text`. Raises argparse.ArgumentTypeError."""
        words = text.split(",")
        if len(words) > self.most:
            raise argparse.ArgumentTypeError(f"expected at most {self.most} values, found {len(words)}")
        return tuple(dict.fromkeys(self.item(word) for word in words))


def whole(low: int, high: int, *, also: tuple[int, ...] = (), unit: str = "") -> Number:
    """Return the type of a whole number from `low` to `high`."""
    return Number(low, high, unit, whole=True, also=also)


PORT = whole(0, 65_535)  # 0: any that is free
SEED = whole(0, 2**63 - 1)
SEEDS = whole(1, MOST_SEEDS)
JOBS = whole(1, MOST_JOBS, also=(-1,))  # -1: all cores
REPEAT = whole(1, 1000)
DESCRIPTOR = whole(0, 65_535)
LATITUDE = Number(-90.0, 90.0, "degrees")
LONGITUDE = Number(-180.0, 180.0, "degrees")
WAIT = Number(0.0, DAY_S, "s")  # for somebody to be there; 0: not at all
BAUD = whole(1200, 12_000_000)
BITRATE = whole(10_000, 1_000_000)


def one_of(*names: str) -> Callable[[str], str]:
    """Return the type of a word that is one of `names`, for the items of a List."""

    def choose(text: str) -> str:
        if text not in names:
            raise argparse.ArgumentTypeError(
                f"expected {' or '.join(names)}, found {shortened(text)}{nearest(text, [*names])}"
            )
        return text

    return choose


def checked(convert: Callable[[str], Any]) -> Callable[[str], Any]:
    """Return the type that does `convert`, whose HilError argparse completes by the option's name."""

    def call(text: str) -> Any:
        try:
            return convert(text)
        except HilError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return call


OUTPUT_FILE = checked(output_file)
ENDPOINT = checked(full_endpoint)  # tcp/HOST:PORT, HOST:PORT or HOST, as tcp/HOST:PORT


def endpoint_or_lan(text: str) -> str:
    """Return an endpoint, or "lan": the one that answers by multicast."""
    return text if text == "lan" else str(ENDPOINT(text))


def host(text: str) -> str:
    """Return the name or address of a machine, an IPv6 address without its brackets."""
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
    """Return host and port of [HOST:]PORT, where something is served; this machine only without a host."""
    name, _, port = text.rpartition(":")
    try:
        return host(name) if name else "127.0.0.1", PORT(port)
    except argparse.ArgumentTypeError:
        words = (
            f"expected [HOST:]PORT, such as 9747 or 0.0.0.0:9747, with a port from 0 to 65535, found {shortened(text)}"
        )
        raise argparse.ArgumentTypeError(words) from None


def place(text: str) -> tuple[float, float]:
    """Return latitude and longitude (degrees) of LAT,LON."""
    words = text.split(",")
    if len(words) != 2:
        raise argparse.ArgumentTypeError(
            f"expected LAT,LON in degrees, such as 59.603,-151.412, found {shortened(text)}"
        )
    return LATITUDE(words[0]), LONGITUDE(words[1])


def _plain(value: float) -> str:
    """Return a number without an exponent where that is short."""
    return f"{value:.0f}" if float(value).is_integer() and abs(value) < 1e9 else f"{value:g}"
