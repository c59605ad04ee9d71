"""Network keys of this project besides those of ROS 2: presence tokens and the clock exchange."""

from struct import Struct
from typing import Any, Literal, NamedTuple

PING = Struct("<16s3q")  # whose; when it was sent; when a pong before it was sent (slave's clock) and came (ours), or 0
PONG = Struct("<16s3q2qd")  # whose; the ping's instant; when it came and was answered; offset, uncertainty, drift
Part = Literal["slave", "master", "observer"]

_PARTS: dict[str, Part] = {"slave": "slave", "master": "master", "observer": "observer"}
_RANKS = frozenset("0123456789")
_LONGEST_NAME = 64  # characters of who somebody is
_LONGEST_NODE = 255  # characters of the name of a node
_LONGEST_IDENT = 64  # hexadecimal digits
_FARTHEST_NS = 4 * 10**18  # that an instant may be from 1970: what is computed of such instants fits into a pong


class Presence(NamedTuple):
    """A participant of a node: the slave itself, a master, an observer.

    `ident` is what its commands are signed with, in hexadecimal; a master of higher `rank` takes over. `process` is for
    people: machine and process.
    """

    node: str
    part: Part
    rank: int
    ident: str
    process: str


def presence_key(presence: Presence) -> str:
    """Return the liveliness token that says so."""
    node, part, rank, ident, process = presence
    return f"uuv_hil/{node}/alive/{part}/{rank}/{ident}/{_plain(process)}"


def presence_keys(node: str, part: str) -> str:
    """Return the tokens of all that are there for a node as `part` ("*": any)."""
    return f"uuv_hil/{node}/alive/{part}/**"


def read_presence(key: str) -> Presence | None:
    """Return what `presence_key` made; None for any other key."""
    parts = key.split("/")
    if len(parts) != 7 or parts[2] != "alive" or parts[3] not in _PARTS:
        return None
    _, node, _, part, rank, ident, process = parts
    if rank not in _RANKS or len(ident) > _LONGEST_IDENT or not _hexadecimal(ident):
        return None
    return Presence(_plain(node, _LONGEST_NODE), _PARTS[part], int(rank), ident, _plain(process))


def router_key(zid: str) -> str:
    """Return the token by which a router knows what else is a router to the library: a slave, or another router."""
    return f"uuv_hil_router/{zid}"


def last_key(node: str, topic: str) -> str:
    """Return where a node tells late joiners the last message of a topic ("*": of all)."""
    return f"uuv_hil/{node}/last/{topic}"


def clock_keys(node: str) -> tuple[str, str, str]:
    """Return the keys of a node's clock exchange: requests, answers, and the masters' requests and reports.

    By the last it judges how old their commands are, so it is only for those who may command, and no others who ask
    stand in their way.
    """
    return f"uuv_hil/{node}/ping", f"uuv_hil/{node}/pong", f"uuv_hil/{node}/ping/master"


def read_clock(layout: Struct, payload: bytes) -> tuple[Any, ...] | None:
    """Return what `layout`, PING or PONG, packed; None for anything else, and for instants that cannot be."""
    if len(payload) != layout.size:
        return None
    values = layout.unpack(payload)
    return values if max(map(abs, values[1:4])) < _FARTHEST_NS else None


def _plain(text: str, most: int = _LONGEST_NAME) -> str:
    """Return `text`, which others wrote, with the characters that a key forbids replaced, and cut."""
    return "".join([c if c.isascii() and (c.isalnum() or c in "._-:") else "_" for c in text[:most]]) or "_"


def _hexadecimal(text: str) -> bool:
    try:
        return bool(bytes.fromhex(text))
    except ValueError:
        return False
