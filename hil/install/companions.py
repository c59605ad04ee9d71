"""Services beside a slave on its board, such as gateways and a recorder: their commands and the addresses they use."""

import argparse
import os
import re
import shlex
from collections.abc import Callable, Sequence
from itertools import takewhile
from typing import Literal, NamedTuple
from urllib.parse import urlsplit

from hil.common.endpoint import split_endpoint
from hil.common.errors import ConfigError
from hil.common.schema import nearest
from hil.scenario.config import Scenario
from hil.scenario.mavlink_records import Mavlink, parse_endpoint

VARIABLE = re.compile(r"[A-Z][A-Z0-9_]*=.*")
MAVLINK_USES: dict[str, Literal["tcp", "udp", "serial"]] = {"tcpin": "tcp", "udpin": "udp", "serial": "serial"}
LOCAL = {"0.0.0.0": "127.0.0.1", "[::]": "[::1]"}  # address at which one machine reaches what listens on all


class Kind(NamedTuple):
    """A service that can run beside a slave: the `module` of its command, and the words after that."""

    module: str
    words: str = "--scenario {scenario}"
    package: str = ""  # of the extra that it needs
    before_slave: bool = False  # the slave connects to it


KINDS = {
    "mavlink": Kind("hil.commands.gateways.mavlink", "{scenario} --vehicle {node}", "pymavlink"),
    "record": Kind("hil.commands.recording.record", package="mcap"),
    "view": Kind("hil.commands.view.command", "--scenario {scenario} --no-browser", "aiohttp"),
    "foxglove": Kind("hil.commands.gateways.foxglove", package="foxglove"),
    "rosbridge": Kind("hil.commands.gateways.rosbridge", package="cbor2"),
    "ros1": Kind("hil.commands.gateways.ros1", package="rosbags"),
    "json": Kind("hil.commands.gateways.json_lines"),
    "metrics": Kind("hil.commands.top", "--scenario {scenario} --prometheus 9747"),
    "router": Kind("hil.commands.router", "--scenario {scenario} --listen {router}", before_slave=True),
}


class Address(NamedTuple):
    """Address of a service, which listens by "tcp" or "udp", connects "out", or opens the "serial" device `host`."""

    use: Literal["tcp", "udp", "out", "serial"]
    host: str
    port: int = 0

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine can reach it."""
        return self.host in ("localhost", "::1") or self.host.startswith("127.")


class Companion(NamedTuple):
    """A service beside the slave: the words after `uuv-hil`, its environment, addresses, and folders it writes to."""

    name: str
    words: tuple[str, ...]
    environment: tuple[str, ...]
    addresses: tuple[Address, ...]
    folders: tuple[str, ...]


def slave_addresses(scenario: Scenario) -> tuple[Address, ...]:
    """Return the two addresses at which a slave listens; none behind a router."""
    host, port = _host_and_port(scenario.slave.listen)
    return () if scenario.network.router else (Address("tcp", host, port), Address("tcp", host, port + 1))


def read_companions(
    texts: Sequence[str],
    scenario: Scenario,
    scenario_words: Sequence[str],
    find_parser: Callable[[str], argparse.ArgumentParser],
) -> tuple[Companion, ...]:
    """Return the services in texts of the form "NAME,NAME" or "[VARIABLE=VALUE ...] NAME OPTION ...".

    `scenario_words`: name of the scenario and the options that change it. `find_parser` returns a module's parser.
    Raises ConfigError, also if two services listen on one port.
    """
    companions: dict[str, Companion] = {}
    ports = {address.port: "the slave" for address in slave_addresses(scenario)}
    for text in texts:
        try:
            words = shlex.split(text)
            environment = list(takewhile(VARIABLE.fullmatch, words))
            uris = [urlsplit(word.partition("=")[2]) for word in environment if "://" in word]  # ROS_MASTER_URI
            remote = [Address("out", uri.hostname) for uri in uris if uri.hostname]
        except ValueError as error:
            raise ConfigError(f"--service {text}: {error}") from None
        names, *options = words[len(environment) :] or [text]
        for name in names.split(","):
            if name in companions:
                raise ConfigError(f"--service: {name!r} is given twice")
            if name not in KINDS:
                raise ConfigError(f"--service: {name!r} is not one of {', '.join(KINDS)}{nearest(name, [*KINDS])}")
            own = _words(name, options, scenario, scenario_words)
            parser = find_parser(KINDS[name].module)
            parsed = parser.parse_args(own)
            addresses = (*_addresses(name, parsed, scenario), *remote)
            for port in {address.port for address in addresses if address.use == "tcp" and address.port}:
                if port in ports:
                    raise ConfigError(f"{name}: {ports[port]} listens on port {port} too; choose another one")
                ports[port] = name
            own = [*parser.prog.split()[1:], *own]
            companions[name] = Companion(name, (*own,), (*environment,), addresses, _folders(name, parsed, scenario))
    return tuple(companions.values())


def _words(name: str, options: Sequence[str], scenario: Scenario, scenario_words: Sequence[str]) -> list[str]:
    """Return the arguments of a service's command. Raises ConfigError if it cannot work beside this slave."""
    kind, router = KINDS[name], scenario.network.router
    if name == "mavlink" and scenario.mavlink and scenario.mavlink.start:
        raise ConfigError("mavlink: the slave itself starts it; leave it out, or set mavlink.start = false")
    if kind.before_slave and not router:
        raise ConfigError(f"{name}: the slave would not use it; set network.router, and network.mode to routed")
    fields = {"scenario": scenario_words[0], "node": scenario.slave.node, "router": router}
    words = [word.format(**fields) for word in kind.words.split()]
    if not kind.before_slave and not any(word.startswith("--connect") for word in options):
        scheme, host, port = split_endpoint(router or scenario.slave.listen)
        words += ["--connect", f"{scheme}/{LOCAL.get(host, host)}:{port}"]
    return [*words, *scenario_words[1:], *options]


def _addresses(name: str, options: argparse.Namespace, scenario: Scenario) -> list[Address]:
    found = [Address("out", *_host_and_port(text)) for text in options.connect or ()]
    listen = getattr(options, "listen", None) or getattr(options, "prometheus", None)
    if listen:
        found.append(Address("tcp", *(_host_and_port(listen) if isinstance(listen, str) else listen)))
    if name == "mavlink":
        settings = scenario.mavlink or Mavlink()
        for text in options.endpoint or settings.endpoints:
            kind, target, port = parse_endpoint(text)
            found.append(Address(MAVLINK_USES.get(kind, "out"), target, port))
    return found


def _folders(name: str, options: argparse.Namespace, scenario: Scenario) -> tuple[str, ...]:
    """Return the folders outside of the service's own ones to which it writes."""
    recording = scenario.recording.folder if name == "record" else ""
    file = getattr(options, "parameters", None) or ""
    return tuple(filter(os.path.isabs, (getattr(options, "output", None) or recording, os.path.dirname(file))))


def _host_and_port(endpoint: str) -> tuple[str, int]:
    _, host, port = split_endpoint(endpoint)
    return host.strip("[]"), port
