"""Declare and watch the participants of a node, and serve its last messages to late joiners."""

import os
from collections.abc import Callable
from contextlib import suppress

import zenoh

from hil.network.session import ANSWER_WITHIN_S, Deliver, Session
from hil.network.tokens import NodeRole, Presence, last_key, presence_key, presence_keys, read_presence
from hil.ros import graph

Watch = Callable[[Presence, bool], None]


def declare_presence(session: Session, node: str, role: NodeRole, ident: str = "", rank: int = 0) -> Callable[[], None]:
    """Announce this process as present for a node, until the returned function is called or the session is lost.

    `ident` and `rank`: see `hil.network.tokens.Presence`; by default a random ident and rank 0.
    """
    name = os.uname().nodename if hasattr(os, "uname") else os.environ.get("COMPUTERNAME", "")  # Windows has no uname
    process = f"{name}:{os.getpid()}"
    return session.declare_token(presence_key(Presence(node, role, rank, ident or os.urandom(16).hex(), process)))


def watch_presence(session: Session, node: str, deliver: Watch) -> None:
    """Call `deliver(presence, alive)` for each process of a node ("*": any) that is present, appears or leaves.

    A process that crashed or lost its link leaves when its lease ends. Otherwise like `Session.watch_tokens`.
    """

    def pass_on(key: str, alive: bool) -> None:
        presence = read_presence(key)
        if presence:
            deliver(presence, alive)

    session.watch_tokens(presence_keys(node, "*"), pass_on)


def watch_nodes(session: Session) -> None:
    """Open a supervised session again while it has links and no other node: the library lost what it has declared.

    For a session that only subscribes or publishes, and cannot know how often messages come. `Session.tokens` may find
    nothing shortly afterwards, as the library answers from what it has.
    """
    alive = set[str]()

    def count(key: str, is_alive: bool) -> None:
        if f"/{session.zid}/" not in key:
            (alive.add if is_alive else alive.discard)(key)

    session.watch_tokens(graph.ALL, count)
    session.supervisor.watch_presence(lambda: bool(alive))


def _nothing() -> None:
    """Do nothing."""


def serve_last(session: Session, node: str, encode_unsent: Callable[[], None] = _nothing) -> None:
    """Serve the last messages of a node's publishers in this session to late joiners, see `fetch_last`.

    `encode_unsent` is called first, to encode samples that were not sent. Large messages are left out: an answer has
    the same priority as samples, which would have to wait for it.
    """

    def answer(query: zenoh.Query) -> None:
        encode_unsent()
        with suppress(zenoh.ZError), query:  # the client may have left; the end of the `with` completes the answer
            for publisher in list(session.publishers):
                name, last = publisher.topic.name, publisher.last
                if last is None or publisher.background or publisher.topic.qos.latched or name.startswith("/"):
                    continue
                if query.key_expr.includes(last_key(node, name)):
                    query.reply(last_key(node, name), last[0], attachment=last[1])

    session.answer(last_key(node, "*"), answer)


def fetch_last(session: Session, node: str, deliver: Deliver, topic: str = "*") -> None:
    """Call `deliver(topic name, payload, attachment)` in this thread for the last message of each topic of the node."""
    for key, payload, attachment in session.query(last_key(node, topic), ANSWER_WITHIN_S):
        deliver(key.rpartition("/")[2], payload, attachment)
