"""`uuv-hil topic`: list, echo, measure and publish topics of ROS 2, and call services, without ROS."""

import argparse
import os
import re
import sys
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from functools import partial

from hil.client.message_text import lines, parse_values
from hil.client.topics import (
    Arrival,
    Arrivals,
    entities,
    first_arrivals,
    rate,
    there_are,
    topic_of,
    whole_type,
)
from hil.commands.listening import add_connect, add_settings, add_wait, network_of, scenario_and_endpoints
from hil.common.clock import NS_PER_S, RateKeeper, now_ns, seconds_ns, to_wall_ns
from hil.common.columns import aligned, result_width
from hil.common.errors import ConfigError, NetworkError
from hil.common.options import Number, add_json, integer, new_parser
from hil.common.stop import StopSignals, pause
from hil.common.text import json_text
from hil.network import services
from hil.network.presence import watch_nodes
from hil.network.publisher import Publisher
from hil.network.roles import open_client_session, open_master_session
from hil.network.session import Session
from hil.ros import graph
from hil.ros import message as ros_message
from hil.ros.graph import Entity, Node

EXAMPLES = """\
examples:
  uuv-hil topic list
  uuv-hil topic echo /uuv1/odom --count 1
  uuv-hil topic hz /uuv1/imu --connect tcp/192.168.3.116:7447
  uuv-hil topic pub /uuv1/cmd_vel geometry_msgs/msg/Twist '{linear: {x: 0.5}}' --rate 20
  uuv-hil topic call /uuv1/arm '{data: true}'
  uuv-hil topic call /uuv1/arm std_srvs/srv/SetBool '{data: true}'

Messages are written as YAML in one line, as JSON, or as TOML (linear.x = 0.5), in the units and frames of ROS: metres,
radians, ENU and FLU. Ctrl-C ends it.
"""
POLL_S = 0.02
SETTLE_S = 1.0  # time for the declarations of the peer to arrive
WINDOW = 10_000  # arrivals that hz evaluates
COUNT = integer(1, 10**9)
RATE = Number(0.001, 10_000.0, "Hz")


def main(arguments: list[str]) -> int:
    """Run list, echo, hz, pub or call; return 0. Raises ConfigError, NetworkError."""
    options = _parser().parse_args(arguments)
    scenario, endpoints = scenario_and_endpoints(options)
    network, security = network_of(scenario)
    actions = {"list": _list, "echo": _echo, "hz": _hz, "pub": _pub, "call": _call}
    interrupted = suppress(KeyboardInterrupt)  # which is how echo, hz and pub end
    with StopSignals() as stop_fd, interrupted:
        if len(endpoints) == 1:  # as a client, for it may be a router's
            wait = partial(pause, stop_fd, POLL_S)
            opened = open_client_session(endpoints[0], network, security, options.wait, wait)
        else:
            opened = open_master_session(*endpoints, network=network, security=security)
        with opened as session:
            _settle(session, stop_fd)
            actions[options.action](session, options, stop_fd)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = new_parser("topic", __doc__, EXAMPLES)
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    list_ = actions.add_parser("list", help="list topics and services, with their types and nodes")
    echo = actions.add_parser("echo", help="print what is published")
    hz = actions.add_parser("hz", help="measure the rate of messages")
    pub = actions.add_parser("pub", help="publish a message repeatedly")
    call = actions.add_parser("call", help="call a service")
    for action in (echo, hz, pub):
        action.add_argument("topic", metavar="TOPIC", help="its full name, such as /uuv1/imu")
        action.add_argument("-n", "--count", metavar="N", type=COUNT, help="exit after this number of messages")
    pub.add_argument("type", metavar="TYPE", help="such as geometry_msgs/msg/Twist")
    pub.add_argument("values", metavar="VALUES", nargs="?", default="", help="fields that are not 0")
    pub.add_argument("--rate", metavar="HZ", type=RATE, help="messages a second [the topic's own, or 1]")
    call.add_argument("service", metavar="SERVICE", help="its full name, such as /uuv1/reset")
    call.add_argument(
        "type", metavar="TYPE", nargs="?", default="", help="such as std_srvs/srv/SetBool [the service's]"
    )
    call.add_argument("values", metavar="VALUES", nargs="?", default="", help="fields that are not 0")
    for action in (list_, echo, hz, pub, call):
        add_connect(action)
        add_settings(action)
        add_wait(action, 5.0, "it")
    for action in (list_, echo, hz, call):
        add_json(action)
    return parser


def _settle(session: Session, stop_fd: int) -> None:
    """Wait until the peer has declared its topics and services: until no more of them come."""
    deadline, before, found = now_ns() + seconds_ns(SETTLE_S), 0, len(session.tokens(graph.ALL))
    while (not before or found > before) and now_ns() < deadline:
        pause(stop_fd, 3 * POLL_S)
        before, found = found, len(session.tokens(graph.ALL))


def _list(session: Session, options: argparse.Namespace, stop_fd: int) -> None:
    found = entities(session)
    print(json_text([entity._asdict() for entity in found]) if options.json else listing(found))


def listing(entities: Sequence[Entity]) -> str:
    """Return two tables: topics with their publishers and subscribers, services with their servers and clients."""
    topics = _table(entities, ("topic", "type", "published by", "subscribed by"), ("MP", "MS"))
    calls = _table(entities, ("service", "type", "answered by", "called by"), ("SS", "SC"))
    return "\n\n".join(part for part in (topics, calls) if part) or "no topics and no services"


def _table(entities: Sequence[Entity], head: tuple[str, ...], kinds: tuple[graph.Kind, graph.Kind]) -> str:
    names = sorted({(entity.topic, entity.type) for entity in entities if entity.kind in kinds})
    rows = [(*name, *[_nodes(entities, name, kind) for kind in kinds]) for name in names]
    return "\n".join(aligned([head, *rows], rule=True, width=result_width())) if rows else ""


def _nodes(entities: Sequence[Entity], name: tuple[str, str], kind: graph.Kind) -> str:
    return ", ".join(sorted({e.node for e in entities if e.kind == kind and (e.topic, e.type) == name})) or "-"


def _first(session: Session, options: argparse.Namespace, stop_fd: int) -> tuple[Arrivals, list[Arrival]]:
    return first_arrivals(session, f"/{options.topic.strip('/')}", options.wait, stop_fd)


def _echo(session: Session, options: argparse.Namespace, stop_fd: int) -> None:
    arrivals, received = _first(session, options, stop_fd)
    count = 0
    while True:
        for _, key, payload in received:
            print("\n".join(_message(key, payload, options.json)), flush=True)
            count += 1
            if count == options.count:
                return
        received = arrivals.receive(stop_fd, 1.0)


def _message(key: str, payload: bytes, as_json: bool) -> list[str]:
    name = graph.ros_name(key.split("/")[-2])
    fields = ros_message.decode(name, payload)
    if as_json:
        return [json_text(fields)]
    return [*lines(fields), "---"] if fields is not None else [f"malformed {name}, {len(payload)} bytes", "---"]


def _hz(session: Session, options: argparse.Namespace, stop_fd: int) -> None:
    arrivals, received = _first(session, options, stop_fd)
    instants: deque[int] = deque(maxlen=WINDOW)
    reported_ns = now_ns()
    while True:
        instants += [instant for instant, _, _ in received]
        ended = options.count is not None and len(instants) >= options.count
        if ended or now_ns() - reported_ns >= NS_PER_S:
            reported_ns = now_ns()
            print(json_text(rate(instants)._asdict()) if options.json else rate_line(instants), flush=True)
        if ended:
            return
        received = arrivals.receive(stop_fd, 1.0)


def rate_line(instants: Sequence[int]) -> str:
    """Return the rate of arrivals (ns) as a line."""
    messages, rate_hz, least, greatest, deviation = rate(instants)
    if rate_hz is None or least is None or greatest is None or deviation is None:
        return f"{messages} messages: no rate yet"
    gaps = f"{least * 1e3:.2f} to {greatest * 1e3:.2f} ms (std {deviation * 1e3:.2f})"
    return f"{rate_hz:.2f} Hz, gaps {gaps}, {messages} messages"


def _pub(session: Session, options: argparse.Namespace, stop_fd: int) -> None:
    name = f"/{options.topic.strip('/')}"
    type_name = whole_type(options.type)
    payload = ros_message.encode(type_name, parse_values(options.values))
    others = {entity.type for entity in entities(session) if entity.topic == name and entity.kind in ("MP", "MS")}
    if others and type_name not in others:
        raise ConfigError(f"{name} has the type {', '.join(sorted(others))}, not {type_name}")
    topic = topic_of(name, type_name)
    rate = options.rate or topic.rate_hz or 1.0
    subscribed = {entity.topic for entity in entities(session) if entity.kind == "MS"}
    if name not in subscribed:
        print(f"nobody subscribes to {name} yet; {there_are(name, subscribed)}", file=sys.stderr, flush=True)
    node = Node(session, f"uuv_hil_topic_{os.getpid()}")
    watch_nodes(session)
    publisher = session.publisher("", topic)
    publisher.gid = node.publishes(topic, "")
    print(f"publishing {type_name} on {name} at {rate:g} Hz", flush=True)
    _repeat(publisher, payload, seconds_ns(1.0 / rate), options.count, stop_fd)


def _repeat(publisher: Publisher, payload: bytes, period_ns: int, count: int | None, stop_fd: int) -> None:
    pause(stop_fd, POLL_S)  # time for subscribers to find the publisher
    schedule = RateKeeper(period_ns, now_ns())
    while count is None or publisher.sequence < count:
        publisher.put(payload, to_wall_ns(now_ns()))
        pause(stop_fd, max(0.0, (schedule.deadline_ns - now_ns()) / NS_PER_S))
        schedule.due(now_ns())


def _call(session: Session, options: argparse.Namespace, stop_fd: int) -> None:
    name = f"/{options.service.strip('/')}"
    offered = {entity.topic: entity.type for entity in entities(session) if entity.kind == "SS"}
    if name not in offered:
        raise NetworkError(f"no server for {name}; {there_are(name, offered)}")
    is_typed = re.fullmatch(r"\w+(/srv)?/\w+", options.type)
    values = options.values if is_typed else f"{options.type} {options.values}".strip()
    if is_typed and options.type.replace("/srv/", "/") != offered[name].replace("/srv/", "/"):
        raise ConfigError(f"{name} has the type {offered[name]}, not {options.type}")
    response = services.call(session, name, offered[name], parse_values(values), options.wait)
    print(json_text(response) if options.json else "\n".join(lines(response)))
