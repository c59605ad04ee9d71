"""Mutual TLS and access control as zenoh settings. Loaded only by sessions with a [security] section.

The name (CN) in its certificate identifies a peer; the TLS handshake proves it. The slave, and a router in between,
enforce what the peer may do.
"""

import os
from typing import Any, NamedTuple

from hil.common.errors import NetworkError
from hil.network.tokens import Role, clock_keys, last_key, presence_keys
from hil.ros.topics import TOPICS

CA, CERTIFICATE, KEY = "ca.pem", "cert.pem", "key.pem"  # the files of a machine's folder

_GRAPH = "@ros2_lv/**"
_EVERYTHING = ["**", _GRAPH]  # "**" does not match key parts that begin with @
_LOOKING_ON = [presence_keys("*", "observer"), _GRAPH]  # presence of an observer, but not of a master or vehicle
_LAST = [last_key("*", "*"), "**/@adv/**"]  # the second one is for latched ROS 2 topics
_ASK = ["declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"]
_BE_THERE = ["liveliness_token"]
_DELIVER = ["put", "delete", "reply", "declare_queryable", "liveliness_token", "declare_subscriber"]
_ALL = sorted({*_ASK, *_BE_THERE, *_DELIVER, "query"})


class Security(NamedTuple):
    """Mutual TLS, and the rights of machines.

    `slave`, `master` and `router` are folders made by `uuv-hil keys add NAME`, each only on its own machine; the name
    of the folder is the name in the certificate. Machines in `may_command` may command; those in `may_listen` receive
    what the vehicle publishes ("*": every machine with a certificate); all others get nothing. A master's ident is not
    bound to a name: a machine that may command can also pose as another one. `vehicles` names the machines of further
    slaves, for a router that serves several.
    """

    slave: str
    master: str
    may_command: tuple[str, ...]
    may_listen: tuple[str, ...] = ()
    router: str = ""
    vehicles: tuple[str, ...] = ()

    def resolve_paths(self, folder: str) -> "Security":
        """Return a copy with its paths resolved against `folder`, the scenario's folder."""
        slave, master, router = (path and os.path.join(folder, path) for path in (self.slave, self.master, self.router))
        return self._replace(slave=slave, master=master, router=router)

    def name(self, role: Role) -> str:
        """Return the name in the certificate of a role. Raises NetworkError like `folder`."""
        return os.path.basename(os.path.abspath(self.folder(role)))

    def folder(self, role: Role) -> str:
        """Return the folder with the keys of a role. Raises NetworkError if the scenario names none."""
        folder: str = self.master if role in ("client", "planner") else getattr(self, role)
        if not folder:
            raise NetworkError(f"[security] names no {role}; add {role} = a folder made by `uuv-hil keys add NAME`")
        return folder


def tls(folder: str) -> dict[str, Any]:
    """Return zenoh's TLS settings for a machine's folder, both directions. Raises NetworkError for a missing file."""
    paths = {name: os.path.join(folder, name) for name in (CA, CERTIFICATE, KEY)}
    for path in paths.values():
        if not os.access(path, os.R_OK):
            fault = "cannot be read by this user" if os.path.exists(path) else "is not there"
            name = os.path.basename(os.path.abspath(folder))
            raise NetworkError(f"{path} {fault}; `uuv-hil keys add {name}` makes the folder, copy it whole")
    return {
        "root_ca_certificate": paths[CA],
        "enable_mtls": True,
        "listen_certificate": paths[CERTIFICATE],
        "listen_private_key": paths[KEY],
        "connect_certificate": paths[CERTIFICATE],
        "connect_private_key": paths[KEY],
        "close_link_on_expiration": True,
    }


def access(security: Security) -> dict[str, Any]:
    """Return the access control of a slave or router: the rights of each certificate; everything else is denied."""
    ping, _, masters_ping = clock_keys("*")
    commands = [f"*/*/{topic.name}/*/*" for topic in TOPICS.values() if topic.from_master]
    rules = [
        _rule("ask", "ingress", _ASK, _EVERYTHING),
        _rule("receive", "egress", _DELIVER, _EVERYTHING),
        _rule("ask the last state", "ingress", ["query"], _LAST),
        _rule("ask the time", "ingress", ["put"], [ping]),
        _rule("watch presence", "ingress", _BE_THERE, _LOOKING_ON),
        _rule("declare a master", "ingress", _BE_THERE, _EVERYTHING),
        _rule("command", "ingress", ["put"], [*commands, masters_ping]),
        _rule("call services", "ingress", ["query"], _EVERYTHING),
        _rule("send all", "ingress", _ALL, _EVERYTHING),
        _rule("receive all", "egress", _ALL, _EVERYTHING),
    ]
    vehicles = [security.name("slave"), *security.vehicles] + ([security.name("router")] if security.router else [])
    listen = ["ask", "receive", "ask the last state", "ask the time", "watch presence"]
    return _table(
        rules,
        _party("commanders", list(security.may_command), [*listen, "declare a master", "command", "call services"]),
        _party("listeners", list(security.may_listen), listen),
        _party("vehicles", vehicles, ["send all", "receive all"]),
    )


def planner_access(security: Security) -> dict[str, Any]:
    """Return the access control of a planner to which other planners connect.

    Planners, the machines in `may_command`, exchange reports. None can command another's vehicle through it or pose as
    a vehicle. Machines in `may_listen` read the reports. The planner's own vehicle may do everything.
    """
    reports = [f"*/*/{TOPICS['formation'].name}/*/*"]
    rules = [
        _rule("ask", "ingress", _ASK, _EVERYTHING),
        _rule("ask others", "egress", _ASK, _EVERYTHING),
        _rule("watch presence", "ingress", _BE_THERE, _LOOKING_ON),
        _rule("show presence", "egress", _BE_THERE, [_GRAPH]),
        _rule("receive reports", "egress", ["put"], reports),
        _rule("report", "ingress", ["put"], reports),
        _rule("send all", "ingress", _ALL, _EVERYTHING),
        _rule("receive all", "egress", _ALL, _EVERYTHING),
    ]
    listen = ["ask", "watch presence", "show presence", "receive reports"]
    return _table(
        rules,
        _party("planners", list(security.may_command), [*listen, "ask others", "report"]),
        _party("listeners", list(security.may_listen), listen),
        _party("vehicles", [security.name("slave")], ["send all", "receive all"]),
    )


def _table(rules: list[dict[str, Any]], *parties: tuple[dict[str, Any], dict[str, Any]] | None) -> dict[str, Any]:
    """Return the zenoh table for these rules and parties; None parties are left out."""
    named = [party for party in parties if party]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [subject for subject, _ in named],
        "policies": [policy for _, policy in named],
    }


def _rule(name: str, flow: str, messages: list[str], keys: list[str]) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys}


def _party(name: str, machines: list[str], rules: list[str]) -> tuple[dict[str, Any], dict[str, Any]] | None:
    """Return the subject and policy for machines with the same rights, by certificate names; None for no machines."""
    if not machines:
        return None
    anybody = "*" in machines
    subject = {"id": name, **({"link_protocols": ["tls"]} if anybody else {"cert_common_names": machines})}
    return subject, {"rules": rules, "subjects": [name]}
