"""Symptom: each message carries the text of its key, which the receiver has to look up: 110 bytes, 40 us a command.

The library gives a numeric id to a key that is declared without wildcards, and to no other.

Not a fault by the library's own rules, so not reported. Remove when
`test_a_subscriber_with_wildcards_gets_the_text_of_each_key` fails.
"""

from typing import Any

import zenoh

from hil.network.publisher import key_of
from hil.ros.topics import TOPICS

OFTEN_HZ = 20.0  # at this rate and above a numeric key id pays off


def frequent_keys(node: str, keys: str) -> list[str]:
    """Return those of `keys` on which a node often sends."""
    pattern = zenoh.KeyExpr(keys)
    often = [key_of(topic, node) for topic in TOPICS.values() if topic.rate_hz >= OFTEN_HZ]
    return [key for key in often if pattern.includes(zenoh.KeyExpr(key))]


def declare_key(key: str, session: zenoh.Session) -> Any:
    """Declare a publisher that sends nothing: the peer then sends a number in place of the key's text.

    The library caches the subscribers of a declared key; otherwise it searches them for each message.
    """
    return session.declare_publisher(session.declare_keyexpr(key))
