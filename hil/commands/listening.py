"""Options by which a command reaches vehicles, the addresses and keys that follow, and the loop of a gateway."""

import argparse
import select
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from hil.common.options import ENDPOINT, LOCAL_SLAVE, WAIT, add_changes, changes_of, endpoint_or_lan
from hil.scenario.config import Scenario, load_scenario, load_single

if TYPE_CHECKING:
    from hil.client.fleet import Fleet
    from hil.recording.mcap_file import Message
    from hil.recording.tap import Tap

POLL_S = 0.02  # between two checks for messages


class Reach(NamedTuple):
    """Arguments of `hil.connect(*endpoints, routed=..., keys=...)` for a fleet; `keys` is a folder, or ""."""

    endpoints: list[str]
    routed: bool
    keys: str


def add_fleet(parser: argparse.ArgumentParser) -> None:
    """Add the options of a command that is the master of all vehicles it reaches; `reach_of` reads them."""
    add_connect(parser, lan=True)
    add_settings(parser)
    parser.add_argument("--routed", action="store_true", help="ENDPOINT is that of a router")
    parser.add_argument("--keys", metavar="FOLDER", default="", help="this machine's certificates")


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add --scenario and --set, for a command that flies nothing and needs only how the network is set up."""
    about = "whose [network] and [security] hold, and where its vehicle listens"
    parser.add_argument("--scenario", metavar="SCENARIO", help=about)
    add_changes(parser)


def add_connect(parser: argparse.ArgumentParser, *, lan: bool = False) -> None:
    """Add --connect, which may be given several times; with `lan` also the word "lan".

    `scenario_and_endpoints` finds its default.
    """
    peer = f"a slave or a router, HOST:PORT{', or lan' if lan else ''}"
    about = f"{peer}; may be given several times [the scenario's, else {LOCAL_SLAVE}]"
    kind = endpoint_or_lan if lan else ENDPOINT
    parser.add_argument("--connect", metavar="ENDPOINT", type=kind, action="append", help=about)


def add_take_over(parser: argparse.ArgumentParser) -> None:
    """Add --take-over: whether this master commands in place of another."""
    parser.add_argument("--take-over", action="store_true", help="take over from a master that commands already")


def add_wait(parser: argparse.ArgumentParser, default: float, what: str = "the vehicle") -> None:
    """Add --wait, how long (s) the command waits for `what`."""
    about = f"time to wait for {what} [%(default)g s]"
    parser.add_argument("--wait", metavar="S", type=WAIT, default=default, help=about)


def scenario_and_endpoints(options: Any) -> tuple[Scenario | None, list[str]]:
    """Return the scenario of `add_settings`, and the endpoints of `add_connect`: else the scenario's, else one here.

    A scenario with a router is reached there. Raises ConfigError, also for a fleet with neither a router nor `connect`:
    each of its vehicles has an endpoint of its own.
    """
    name, connect = options.scenario, options.connect
    if name is None:
        return None, connect or [LOCAL_SLAVE]
    scenario = load_scenario(name, changes_of(options))
    if connect:
        return scenario, connect
    if scenario.network.router:
        return scenario, [scenario.network.router]
    if scenario.member:
        ends = " ".join([f"--connect {member.listen}" for member in scenario.member])
        load_single(name, remedy=f"and each vehicle has an endpoint of its own: name those to listen to, {ends}")
    return scenario, [scenario.slave.listen]


def reach_of(options: Any) -> tuple[Scenario | None, Reach]:
    """Return the scenario and how its fleet is reached, by the options of `add_fleet`. Raises ConfigError."""
    scenario, endpoints = scenario_and_endpoints(options)
    return scenario, Reach(endpoints, options.routed or is_routed(scenario), options.keys or keys_of(scenario))


def is_routed(scenario: Scenario | None) -> bool:
    """Return whether the scenario's vehicles are reached through a router."""
    return bool(scenario and scenario.network.mode == "routed")


def keys_of(scenario: Scenario | None) -> str:
    """Return the folder of a master's certificates; "" where the scenario asks for none."""
    return scenario.security.folder("master") if scenario and scenario.security else ""


def presence(names: list[str], endpoints: list[str]) -> str:
    """Return which vehicles are there, or who is waited for and where, as a line."""
    if names:
        return f"here: {', '.join(names)}"
    return f"no vehicle at {', '.join(endpoints)} yet; waiting for one (`uuv-hil slave` there)"


def forward(
    tap: "Tap",
    show: Callable[["list[Message]"], None],
    fleet: "Fleet",
    endpoints: list[str],
    stop_fd: int,
    is_over: Callable[[], bool] = lambda: False,
) -> None:
    """Show what vehicles publish until `stop_fd` is readable; print who is there, and again when that changes."""
    names: list[str] | None = None
    while not is_over() and not select.select((stop_fd,), (), (), POLL_S)[0]:
        show(tap.receive())
        if fleet.names != names:
            names = fleet.names
            print(presence(names, endpoints), flush=True)
