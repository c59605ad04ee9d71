"""Options with which a command reaches vehicles, and the endpoints, keys and sessions they give."""

import argparse
from typing import Any, NamedTuple

from hil.common.options import LOCAL_SLAVE, WAIT, add_changes, changes_of, endpoint_or_lan
from hil.network.security import Security
from hil.network.settings import Network
from hil.scenario.config import Scenario, load_scenario, load_single


class ConnectArguments(NamedTuple):
    """Arguments of `hil.connect(*endpoints, routed=..., keys=...)` for a fleet; `keys` is a folder, or ""."""

    endpoints: list[str]
    routed: bool
    keys: str


def add_fleet(parser: argparse.ArgumentParser) -> None:
    """Add the options of a command that is the master of all vehicles it reaches; `connect_arguments` reads them."""
    add_connect(parser)
    add_settings(parser)
    parser.add_argument("--routed", action="store_true", help="ENDPOINT is that of a router")
    parser.add_argument("--keys", metavar="FOLDER", default="", help="this machine's certificates")


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add --scenario and --set, for a command that needs only the network settings of a scenario."""
    about = "scenario with the [network] and [security] settings, and the endpoint of its vehicle"
    parser.add_argument("--scenario", metavar="SCENARIO", help=about)
    add_changes(parser)


def add_connect(parser: argparse.ArgumentParser) -> None:
    """Add --connect, which may be given several times; `scenario_and_endpoints` finds its default."""
    about = f"a slave or a router, HOST:PORT, or lan; may be given several times [the scenario's, else {LOCAL_SLAVE}]"
    parser.add_argument("--connect", metavar="ENDPOINT", type=endpoint_or_lan, action="append", help=about)


def add_take_over(parser: argparse.ArgumentParser) -> None:
    """Add --take-over, with which this master commands in place of another."""
    parser.add_argument("--take-over", action="store_true", help="take over from a master that commands already")


def add_wait(parser: argparse.ArgumentParser, default: float, what: str = "the vehicle") -> None:
    """Add --wait, the time (s) that the command waits for `what`."""
    about = f"time to wait for {what} [%(default)g s]"
    parser.add_argument("--wait", metavar="S", type=WAIT, default=default, help=about)


def scenario_and_endpoints(options: Any) -> tuple[Scenario | None, list[str]]:
    """Return the scenario of `add_settings` and the endpoints of `add_connect`: by default its own, else a local one.

    A scenario with a router has the router's endpoint. Raises ConfigError, also for a fleet with neither a router nor
    --connect: each of its vehicles has an endpoint of its own.
    """
    name, connect = options.scenario, options.connect
    if name is None:
        return None, connect or [LOCAL_SLAVE]
    scenario = load_scenario(name, changes_of(options))
    if connect:
        return scenario, connect
    if scenario.member and not scenario.network.router:
        choices = " ".join([f"--connect {member.listen}" for member in scenario.member])
        load_single(name, remedy=f"and each vehicle has an endpoint of its own: name those to listen to, {choices}")
    return scenario, [own_endpoint(scenario)]


def own_endpoint(scenario: Scenario) -> str:
    """Return the endpoint at which a scenario's vehicle is reached: its router's, else its slave's."""
    return scenario.network.router or scenario.slave.listen


def connect_arguments(options: Any) -> tuple[Scenario | None, ConnectArguments]:
    """Return the scenario, and the arguments to connect to its fleet, from `add_fleet`. Raises ConfigError."""
    scenario, endpoints = scenario_and_endpoints(options)
    return scenario, ConnectArguments(
        endpoints, options.routed or is_routed(scenario), options.keys or keys_of(scenario)
    )


def is_routed(scenario: Scenario | None) -> bool:
    """Return whether the scenario's vehicles are reached through a router."""
    return bool(scenario and scenario.network.mode == "routed")


def keys_of(scenario: Scenario | None) -> str:
    """Return the folder of a master's certificates; "" if the scenario has no [security]."""
    return scenario.security.folder("master") if scenario and scenario.security else ""


def presence(names: list[str], endpoints: list[str]) -> str:
    """Return a line: the vehicles that are connected, or the endpoints at which one is expected."""
    if names:
        return f"connected: {', '.join(names)}"
    return f"no vehicle at {', '.join(endpoints)} yet; waiting for one (`uuv-hil slave` there)"


def network_of(scenario: Scenario | None) -> tuple[Network, Security | None]:
    """Return the [network] and [security] of a scenario, or the defaults without one."""
    return (scenario.network, scenario.security) if scenario else (Network(), None)
