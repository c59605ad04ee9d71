"""Declare and watch the participants of a node, and serve its last messages to late joiners."""

import os
from collections.abc import Callable
from contextlib import suppress

import zenoh

from hil.network.session import ANSWER_WITHIN_S, Deliver, Session
from hil.network.tokens import Part, Presence, last_key, presence_key, presence_keys, read_presence

Watch = Callable[[Presence, bool], None]


def declare_presence(session: Session, node: str, part: Part, ident: str = "", rank: int = 0) -> Callable[[], None]:
    """Announce this process as present for a node, until the returned function is called or the session lost.

    `ident` and `rank`: see `hil.network.tokens.Presence`; by default one of chance and 0.
    """
    name = os.uname().nodename if hasattr(os, "uname") else os.environ.get("COMPUTERNAME", "")  # Windows has none
    process = f"{name}:{os.getpid()}"
    return session.declare_token(presence_key(Presence(node, part, rank, ident or os.urandom(16).hex(), process)))


def watch_presence(session: Session, node: str, deliver: Watch) -> None:
    """Call `deliver(presence, alive)` for each process that is present for a node ("*": any), comes or goes.

    One that vanishes without a word goes after the lease. Otherwise like `Session.subscribe`.
    """

    def pass_on(key: str, alive: bool) -> None:
        presence = read_presence(key)
        if presence:
            deliver(presence, alive)

    session.watch_tokens(presence_keys(node, "*"), pass_on)


def _nothing() -> None:
    """Do nothing: there is nothing to update."""


def serve_last(session: Session, node: str, catch_up: Callable[[], None] = _nothing) -> None:
    """Serve late joiners the last messages of this session's publishers of a node, see `fetch_last`.

    `catch_up` is called before: it makes the last of each be the last indeed. What is large is left out: an answer has
    no less priority than the samples, which would wait for it.
    """

    def answer(query: zenoh.Query) -> None:
        catch_up()
        with suppress(zenoh.ZError), query:  # who asked may be gone; leaving the query says that this was all
            for publisher in list(session.publishers):
                name, last = publisher.topic.name, publisher.last
                if last is None or publisher.background or publisher.topic.qos.latched or name.startswith("/"):
                    continue
                if query.key_expr.includes(last_key(node, name)):
                    query.reply(last_key(node, name), last[0], attachment=last[1])

    session.answer(last_key(node, "*"), answer)


def fetch_last(session: Session, node: str, deliver: Deliver, topic: str = "*") -> None:
    """Call `deliver(topic name, payload, attachment)`, here and now, for the last message of each topic of the node."""
    for key, payload, attachment in session.query(last_key(node, topic), ANSWER_WITHIN_S):
        deliver(key.rpartition("/")[2], payload, attachment)
