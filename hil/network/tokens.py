"""Roles of processes on the network, and the keys besides those of ROS 2: presence tokens and the clock exchange."""

from struct import Struct
from typing import Any, Literal, NamedTuple

PING = Struct("<16s3q")  # sender; send time; last pong's send time (slave's clock) and receive time (sender's), or 0
PONG = Struct("<16s3q2qd")  # receiver; the ping's send time; times it came and was answered; offset, uncertainty, drift
Role = Literal["slave", "master", "planner", "client", "router", "imaging"]  # of a process
NodeRole = Literal["slave", "master", "observer"]

_ROLES: dict[str, NodeRole] = {"slave": "slave", "master": "master", "observer": "observer"}
_RANKS = frozenset("0123456789")
_LONGEST_NAME = 64  # characters of a process name
_LONGEST_NODE = 255  # characters of a node name
_LONGEST_IDENT = 64  # hexadecimal digits
_FARTHEST_NS = 4 * 10**18  # limit of times, ns from 1970; values computed from them fit into a pong


class Presence(NamedTuple):
    """A participant of a node: the slave itself, a master, or an observer.

    `ident` is the sender id (gid) of its commands, in hexadecimal. A master with a higher `rank` takes over. `process`
    is for people to read: machine and process id.
    """

    node: str
    role: NodeRole
    rank: int
    ident: str
    process: str


def presence_key(presence: Presence) -> str:
    """Return the key of the liveliness token that announces `presence`."""
    node, part, rank, ident, process = presence
    return f"uuv_hil/{node}/alive/{part}/{rank}/{ident}/{_plain(process)}"


def presence_keys(node: str, role: str) -> str:
    """Return the key expression for the tokens of all participants of a node with role `role` ("*": any)."""
    return f"uuv_hil/{node}/alive/{role}/**"


def read_presence(key: str) -> Presence | None:
    """Return the presence in a key of `presence_key`; None for any other key."""
    parts = key.split("/")
    if len(parts) != 7 or parts[2] != "alive" or parts[3] not in _ROLES:
        return None
    _, node, _, part, rank, ident, process = parts
    if rank not in _RANKS or len(ident) > _LONGEST_IDENT or not _hexadecimal(ident):
        return None
    return Presence(_plain(node, _LONGEST_NODE), _ROLES[part], int(rank), ident, _plain(process))


def router_key(zid: str) -> str:
    """Return the token that marks a router of this project, because slaves are routers to zenoh too."""
    return f"uuv_hil_router/{zid}"


def last_key(node: str, topic: str) -> str:
    """Return the key on which a node serves late joiners the last message of a topic ("*": of all)."""
    return f"uuv_hil/{node}/last/{topic}"


def clock_keys(node: str) -> tuple[str, str, str]:
    """Return the keys of a node's clock exchange: requests, answers, and the masters' requests and reports.

    From the masters' key the slave computes the age of their commands, so only machines that may command can use it,
    and pings of others cannot delay it.
    """
    return f"uuv_hil/{node}/ping", f"uuv_hil/{node}/pong", f"uuv_hil/{node}/ping/master"


def read_clock(layout: Struct, payload: bytes) -> tuple[Any, ...] | None:
    """Return the values of a PING or PONG `layout`; None for a wrong length or impossible times."""
    if len(payload) != layout.size:
        return None
    values = layout.unpack(payload)
    return values if max(map(abs, values[1:4])) < _FARTHEST_NS else None


def _plain(text: str, most: int = _LONGEST_NAME) -> str:
    """Return `text` from the network with the characters that keys forbid replaced, cut to `most` characters."""
    return "".join([c if c.isascii() and (c.isalnum() or c in "._-:") else "_" for c in text[:most]]) or "_"


def _hexadecimal(text: str) -> bool:
    try:
        return bool(bytes.fromhex(text))
    except ValueError:
        return False
