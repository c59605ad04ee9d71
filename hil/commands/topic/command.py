"""`uuv-hil topic`: list, echo, measure and publish topics of ROS 2, and call services, without ROS."""

import argparse
import os
import select
import statistics
import sys
from collections import deque
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

from hil.commands.listening import add_connect, add_settings, add_wait, scenario_and_endpoints
from hil.commands.topic.text import lines, parse_values
from hil.common.clock import NS_PER_S, RateKeeper, now_ns, seconds_ns, to_wall_ns
from hil.common.columns import aligned
from hil.common.errors import ConfigError, NetworkError
from hil.common.options import Number, add_json, integer, new_parser
from hil.common.schema import nearest
from hil.common.stop import StopSignals, Wakeup, is_stopped
from hil.common.text import json_text
from hil.network import services
from hil.network.presence import fetch_last
from hil.network.publisher import Publisher
from hil.network.roles import open_client_session, open_master_session
from hil.network.session import Session
from hil.ros import dialect, encoders, graph, types
from hil.ros import message as ros_message
from hil.ros.diagnostics import Diagnostics
from hil.ros.graph import Entity, Node
from hil.ros.topics import TOPICS, Topic

EXAMPLES = """\
examples:
  uuv-hil topic list
  uuv-hil topic echo /uuv1/odom --count 1
  uuv-hil topic hz /uuv1/imu --connect tcp/192.168.3.116:7447
  uuv-hil topic pub /uuv1/cmd_vel geometry_msgs/msg/Twist '{linear: {x: 0.5}}' --rate 20
  uuv-hil topic call /uuv1/arm '{data: true}'

Messages are written as YAML in one line, as JSON, or as TOML (linear.x = 0.5), in the units and frames of ROS: metres,
radians, ENU and FLU. Ctrl-C ends it.
"""
POLL_S = 0.02
SETTLE_S = 1.0  # time for the declarations of the peer to arrive
WINDOW = 10_000  # arrivals that hz evaluates
QUEUE = 1000
COUNT = integer(1, 10**9)
RATE = Number(0.001, 10_000.0, "Hz")


def main(arguments: list[str]) -> int:
    """Run list, echo, hz, pub or call; return 0. Raises ConfigError, NetworkError."""
    options = _parser().parse_args(arguments)
    scenario, endpoints = scenario_and_endpoints(options)
    secure: dict[str, Any] = {"network": scenario.network, "security": scenario.security} if scenario else {}
    actions = {"list": _list, "echo": _echo, "hz": _hz, "pub": _pub, "call": _call}
    interrupted = suppress(KeyboardInterrupt)  # which is how echo, hz and pub end
    with StopSignals() as stop_fd, interrupted:

        def pause() -> None:
            _pause(stop_fd, POLL_S)

        with _open(endpoints, secure, options.wait, pause) as session:
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
    call.add_argument("values", metavar="VALUES", nargs="?", default="", help="fields that are not 0")
    for action in (list_, echo, hz, pub, call):
        add_connect(action)
        add_settings(action)
        add_wait(action, 5.0, "it")
    for action in (list_, echo, hz, call):
        add_json(action)
    return parser


def _open(endpoints: list[str], secure: dict[str, Any], seconds: float, pause: Callable[[], None]) -> Session:
    """Open the session: as a client at one endpoint, which may be a router, else as a master of several."""
    if len(endpoints) == 1:
        return open_client_session(endpoints[0], **secure, seconds=seconds, pause=pause)
    return open_master_session(*endpoints, **secure)


def _settle(session: Session, stop_fd: int) -> None:
    """Wait until the peer has declared its topics and services."""
    deadline = now_ns() + seconds_ns(SETTLE_S)
    while not session.tokens(graph.ALL) and now_ns() < deadline:
        _pause(stop_fd, POLL_S)


def _pause(stop_fd: int, seconds: float) -> None:
    if is_stopped(stop_fd, seconds):
        raise KeyboardInterrupt


def _entities(session: Session) -> list[Entity]:
    return [entity for key in session.tokens(graph.ALL) if (entity := graph.read_token(key))]


def _list(session: Session, options: argparse.Namespace, stop_fd: int) -> None:
    entities = _entities(session)
    print(json_text([entity._asdict() for entity in entities]) if options.json else listing(entities))


def listing(entities: Sequence[Entity]) -> str:
    """Return two tables: topics with their publishers and subscribers, services with their servers and clients."""
    topics = _table(entities, ("topic", "type", "published by", "subscribed by"), ("MP", "MS"))
    calls = _table(entities, ("service", "type", "answered by", "called by"), ("SS", "SC"))
    return "\n\n".join(part for part in (topics, calls) if part) or "no topics and no services"


def _table(entities: Sequence[Entity], head: tuple[str, ...], kinds: tuple[graph.Kind, graph.Kind]) -> str:
    names = sorted({(entity.topic, entity.type) for entity in entities if entity.kind in kinds})
    rows = [(*name, *[_nodes(entities, name, kind) for kind in kinds]) for name in names]
    return "\n".join(aligned([head, *rows], rule=True)) if rows else ""


def _nodes(entities: Sequence[Entity], name: tuple[str, str], kind: graph.Kind) -> str:
    return ", ".join(sorted({e.node for e in entities if e.kind == kind and (e.topic, e.type) == name})) or "-"


class _Arrivals:
    """Queue of a topic's received messages, with instant (ns), key and payload; a loop can wait on it."""

    def __init__(self, session: Session, topic: str, latched: bool) -> None:
        self._event = Wakeup()
        self._waiting: deque[tuple[int, str, bytes]] = deque(maxlen=QUEUE)
        session.subscribe_keys(f"{dialect.domain()}/{topic.strip('/')}/*/*", self._deliver, QUEUE, latched)

    def _deliver(self, key: str, payload: bytes, _attachment: bytes) -> None:
        self._waiting.append((now_ns(), key, payload))
        self._event.set()

    def receive(self, stop_fd: int, seconds: float) -> list[tuple[int, str, bytes]]:
        """Return the messages received so far; wait for one up to `seconds` if there is none."""
        ready = select.select((stop_fd, self._event.fileno()), (), (), seconds)[0]
        if stop_fd in ready:
            raise KeyboardInterrupt
        if ready:
            self._event.clear()
        return [self._waiting.popleft() for _ in range(len(self._waiting))]


def _first(session: Session, options: argparse.Namespace, stop_fd: int) -> tuple[_Arrivals, Any]:
    """Return the arrivals of the topic, and the first of them."""
    name = f"/{options.topic.strip('/')}"
    published = _published(session)
    latched = name in published and published[name].qos.latched
    arrivals = _Arrivals(session, name, latched)
    if name in published:  # a node in the graph: without one, descriptions of a vehicle are not made
        listener = Node(session, f"uuv_hil_topic_{os.getpid()}")
        listener.subscribes(_row(name, published[name].type)._replace(qos=published[name].qos), "")
    received = arrivals.receive(stop_fd, options.wait)
    if not received:
        published = _published(session)  # topics declared since
        if name in published:
            raise NetworkError(f"{name} is published, but nothing was received within {options.wait:g} s; raise --wait")
        if sensor := _starting(session, name, published):
            raise NetworkError(
                f"nothing was received on {name} within {options.wait:g} s: the process of the pictures of {sensor} is "
                "still starting; ask again, or raise --wait"
            )
        raise NetworkError(f"nobody publishes {name}; {_there_is(name, published)}")
    return arrivals, received


def _starting(session: Session, name: str, published: Collection[str]) -> str:
    """Return the sensor of a topic if it makes pictures and has not published any yet; else ""."""
    node, _, topic = name[1:].partition("/")
    sensor = topic.partition("/")[0]
    if any(each.startswith(f"/{node}/{sensor}/") for each in published):
        return ""
    received: list[bytes] = []
    fetch_last(session, node, lambda _topic, payload, *_: received.append(payload), "diagnostics")
    for payload in received:
        statuses = encoders.decode_diagnostics(payload)
        if statuses and sensor in (Diagnostics(statuses[0][3]).imaging_requested or {}):
            return sensor
    return ""


def _published(session: Session) -> dict[str, Entity]:
    return {entity.topic: entity for entity in _entities(session) if entity.kind == "MP"}


def _there_is(name: str, known: Collection[str]) -> str:
    return f"there are: {', '.join(sorted(known)) or 'none'}{nearest(name, list(known))}"


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


class Rate(NamedTuple):
    """Rate of messages; there is none before the second one."""

    messages: int
    rate_hz: float | None = None
    least_gap_s: float | None = None
    greatest_gap_s: float | None = None
    gap_deviation_s: float | None = None


def rate(instants: Sequence[int]) -> Rate:
    """Return the mean rate of arrivals (ns), and how their gaps differ."""
    gaps = [(b - a) / NS_PER_S for a, b in zip(list(instants), list(instants)[1:], strict=False)]
    if not gaps:
        return Rate(len(instants))
    mean = len(gaps) / max(sum(gaps), 1e-9)
    return Rate(len(instants), mean, min(gaps), max(gaps), statistics.pstdev(gaps))


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
    others = {entity.type for entity in _entities(session) if entity.topic == name and entity.kind in ("MP", "MS")}
    if others and type_name not in others:
        raise ConfigError(f"{name} has the type {', '.join(sorted(others))}, not {type_name}")
    topic = _row(name, type_name)
    rate = options.rate or topic.rate_hz or 1.0
    subscribed = {entity.topic for entity in _entities(session) if entity.kind == "MS"}
    if name not in subscribed:
        print(f"nobody subscribes to {name} yet; {_there_is(name, subscribed)}", file=sys.stderr, flush=True)
    node = Node(session, f"uuv_hil_topic_{os.getpid()}")
    publisher = session.publisher("", topic)
    node.publishes(topic, "")
    print(f"publishing {type_name} on {name} at {rate:g} Hz", flush=True)
    _repeat(publisher, payload, seconds_ns(1.0 / rate), options.count, stop_fd)


def _repeat(publisher: Publisher, payload: bytes, period_ns: int, count: int | None, stop_fd: int) -> None:
    _pause(stop_fd, POLL_S)  # time for subscribers to find the publisher
    schedule = RateKeeper(period_ns, now_ns())
    while count is None or publisher.sequence < count:
        publisher.put(payload, to_wall_ns(now_ns()))
        _pause(stop_fd, max(0.0, (schedule.deadline_ns - now_ns()) / NS_PER_S))
        schedule.due(now_ns())


def _row(name: str, type_name: str) -> Topic:
    """Return the topic of a full name, with the priority of our topic of that name and type."""
    known = TOPICS.get(name) or TOPICS.get(name.rpartition("/")[2])
    if known and known.type == type_name:
        return known._replace(name=name)
    return Topic(name, type_name, 0, "data")


def whole_type(name: str) -> str:
    """Return "geometry_msgs/msg/Twist", also of "geometry_msgs/Twist". Raises ConfigError for an unknown one."""
    package, _, last = name.rpartition("/")
    whole = name if "/" in package else f"{package}/msg/{last}"
    types.definition(whole)
    return whole


def _call(session: Session, options: argparse.Namespace, stop_fd: int) -> None:
    name = f"/{options.service.strip('/')}"
    offered = {entity.topic: entity.type for entity in _entities(session) if entity.kind == "SS"}
    if name not in offered:
        raise NetworkError(f"no server for {name}; {_there_is(name, offered)}")
    response = services.call(session, name, offered[name], parse_values(options.values), options.wait)
    print(json_text(response) if options.json else "\n".join(lines(response)))
