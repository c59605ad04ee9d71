"""Run a hostile peer until it is ended: `python -m tools.faults.attacker KIND ENDPOINT`.

subscriptions   declares 5,000 subscriptions and leaves, again and again
tokens          declares 5,000 liveliness tokens whose names have escape sequences in them, and leaves
not_a_number    commands of all kinds whose numbers are not finite, 500 a second
replay          earlier commands of the planner, with the planner's identity, sequence numbers and times
connections     connects to both ports and closes, 100 times a second
bytes           connects and sends bytes that are not zenoh
"""

import math
import os
import random
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress

import zenoh

from hil.common.clock import now_ns, to_wall_ns
from hil.common.endpoint import split_endpoint
from hil.common.lifeline import die_with_parent
from hil.network.publisher import key_of
from hil.network.settings import Network, settings
from hil.ros import encoders as ros
from hil.ros.commands import encode_number, encode_thrusts
from hil.ros.topics import COMMANDS, TOPICS

MANY = 5000
NODE = "uuv1"
THRUSTERS = 6


def main(kind: str, endpoint: str) -> None:
    """Attack until ended."""
    die_with_parent()
    attacks: dict[str, Callable[[str], None]] = {
        "subscriptions": _subscriptions, "tokens": _tokens, "not_a_number": _not_a_number,
        "replay": _replay, "connections": _connections, "bytes": _bytes,
    }  # fmt: skip
    attacks[kind](endpoint)


def _open(endpoint: str) -> zenoh.Session:
    return zenoh.open(zenoh.Config.from_json5(settings("client", (), (endpoint,), Network(), None)))


def _report_ready() -> None:
    print("attacking", flush=True)


def _subscriptions(endpoint: str) -> None:
    _report_ready()
    while True:
        with suppress(zenoh.ZError), _open(endpoint) as session:
            held = [session.declare_subscriber(f"0/{NODE}/x{i}/**", zenoh.handlers.RingChannel(1)) for i in range(MANY)]
            time.sleep(0.5)
            del held


def _tokens(endpoint: str) -> None:
    with _open(endpoint) as session:
        _report_ready()
        held = []
        for i in range(MANY):
            with suppress(zenoh.ZError):
                held.append(session.liveliness().declare_token(f"uuv_hil/{NODE}/alive/master/0/{i:032x}/\x1b[2J{i}"))
        time.sleep(3600.0)


def _sender(session: zenoh.Session, topic: str) -> Callable[[bytes, int, int, bytes], None]:
    publisher = session.declare_publisher(key_of(TOPICS[topic], NODE), express=True)

    def send(payload: bytes, sequence: int, time_ns: int, gid: bytes) -> None:
        publisher.put(payload, attachment=ros.pack_attachment(sequence, time_ns, gid))

    return send


def _not_a_number(endpoint: str) -> None:
    bad = (math.nan, math.inf, -math.inf, 1e300)
    with _open(endpoint) as session:
        send = {topic: _sender(session, topic) for topic in COMMANDS}
        gid, sequence = os.urandom(16), 0
        _report_ready()
        while True:
            for value in bad:
                sequence += 1
                now = to_wall_ns(now_ns())
                send["cmd_thrusters"](encode_thrusts([value] * THRUSTERS), sequence, now, gid)
                send["cmd_vel"](ros.encode_twist((value, value, value), (0.0, 0.0, value)), sequence, now, gid)
                send["cmd_depth"](encode_number(value), sequence, now, gid)
                send["cmd_heading"](encode_number(value), sequence, now, gid)
            time.sleep(4 * len(bad) / 500)


def _replay(endpoint: str) -> None:
    """Repeat the messages of the first 0.4 s endlessly."""
    with _open(endpoint) as session:
        key = key_of(TOPICS["cmd_thrusters"], NODE)
        channel = session.declare_subscriber(key, zenoh.handlers.RingChannel(64))
        time.sleep(0.4)
        received = []
        while sample := channel.try_recv():
            received.append((sample.payload.to_bytes(), sample.attachment.to_bytes() if sample.attachment else b""))
        publisher = session.declare_publisher(key, express=True)
        print(f"attacking with {len(received)} commands", flush=True)
        while True:
            for payload, attachment in received:
                publisher.put(payload, attachment=attachment)
                time.sleep(0.005)
            time.sleep(0.01)


def _ports(endpoint: str) -> tuple[tuple[str, int], tuple[str, int]]:
    _, host, port = split_endpoint(endpoint)
    return (host, port), (host, port + 1)


def _connections(endpoint: str) -> None:
    _report_ready()
    while True:
        for address in _ports(endpoint):
            with suppress(OSError), socket.create_connection(address, 1.0):
                pass
        time.sleep(0.02)


def _bytes(endpoint: str) -> None:
    noise = random.Random(1)
    _report_ready()
    while True:
        for address in _ports(endpoint):
            with suppress(OSError), socket.create_connection(address, 1.0) as end:
                end.sendall(noise.randbytes(noise.randrange(1, 2000)))
        time.sleep(0.02)


if __name__ == "__main__":
    main(*sys.argv[1:3])
