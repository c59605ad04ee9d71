"""Receive what publishers of ROS 2 Lyrical and later send: sequences of numbers, as in pictures and modem messages.

rmw_zenoh 0.10.5 and later (its change 930) sends them on keys of its own while every subscription in the graph takes
them there; its publishers have a part BACKENDS in their tokens. A subscription without it makes them use a topic's
usual key.
"""

from contextlib import suppress

import zenoh

from hil.network.session import Session
from hil.ros import dialect
from hil.ros.encoders import data_key
from hil.ros.graph import BACKED, Node, read_token

MOST = 4096  # topics, because anybody can invent names


def join_publishers(session: Session, keys: str, name: str) -> None:
    """Subscribe in the graph to such publishers on `keys`, now and later, as the node `name`; else there is no node."""
    wanted, joined, nodes = zenoh.KeyExpr(keys), set[str](), list[Node]()

    def join(token: str, alive: bool) -> None:
        publisher = read_token(token) if alive else None
        if publisher is None or len(joined) >= MOST:
            return
        key = data_key(dialect.domain(), publisher.topic, publisher.type, publisher.type_hash)
        with suppress(zenoh.ZError):  # a name that is no key
            if key not in joined and wanted.intersects(zenoh.KeyExpr(key)):
                joined.add(key)
                nodes.extend([] if nodes else [Node(session, name)])
                nodes[0].joins(publisher)

    session.watch_tokens(BACKED, join)
