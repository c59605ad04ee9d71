"""The ROS 2 graph on the network: nodes and their publishers, subscribers, services and clients.

Each of them is a liveliness token, a key that exists as long as the session that declared it, in the form of rmw_zenoh
(ros2/rmw_zenoh, docs/design.md and src/detail/liveliness_utils.cpp):

    @ros2_lv/DOMAIN/SESSION/NODE ID/ID/KIND/ENCLAVE/NAMESPACE/NODE [/TOPIC/TYPE/HASH/QOS [/BACKENDS]]

Names have "%" instead of "/" there. Not modelled: security enclaves, and deadlines, lifespans and leases in QoS.

Publishers with BACKENDS (rmw_zenoh 0.10.5 and later, types with sequences of numbers) send on their topic's usual key
only while the graph has a subscription without BACKENDS.
"""

from collections.abc import Callable
from itertools import count
from typing import Literal, NamedTuple, Protocol

from hil.ros import dialect
from hil.ros.encoders import dds_name
from hil.ros.gid import gid_of
from hil.ros.topics import Qos, Topic, hash_of

ALL = "@ros2_lv/*/**"  # all domains; `read_token` ignores other domains
SUBSCRIPTIONS = "@ros2_lv/*/*/*/*/MS/**"  # only subscriptions
BACKED = f"@ros2_lv/*/*/*/*/MP{8 * '/*'}/**"  # only publishers with BACKENDS
Kind = Literal["NN", "MP", "MS", "SS", "SC"]  # node, publisher, subscription, service, client
KINDS: dict[str, Kind] = {"NN": "NN", "MP": "MP", "MS": "MS", "SS": "SS", "SC": "SC"}
SERVICE_QOS = Qos()

# Constants of rmw/types.h; an empty field means rmw_zenoh's default, which is reliable, volatile, depth 42.
_BEST_EFFORT, _TRANSIENT_LOCAL, _KEEP_ALL, _DEFAULT_DEPTH = "2", "1", "2", 42
_NODE_PARTS, _ENDPOINT_PARTS = 9, 13
Identity = tuple[str, int]  # of a node: its session, and its number in the session
ELSEWHERE = 1_000_000  # first number of endpoints that another process declares for a node
_numbers = count()  # for this process's nodes and endpoints, to make them unique in a session


class Entity(NamedTuple):
    """One node, or one endpoint of a node. `node` and `topic` are full names ("/uuv1", "/uuv1/imu").

    `session` identifies the session, `node_id` and `ident` the entity in it. A node has no topic, type and hash.
    """

    kind: Kind
    node: str
    session: str
    node_id: int
    ident: int
    topic: str = ""
    type: str = ""
    type_hash: str = ""
    qos: Qos = Qos()


def plain_name(name: str) -> str:
    """Return a name, such as a thruster's, as a part of a ROS name: letters, digits and _, not a digit first."""
    plain = "".join([c if c.isascii() and c.isalnum() else "_" for c in name])
    return f"_{plain}" if plain[:1].isdigit() else plain


def token(entity: Entity) -> str:
    """Return the key of the entity's liveliness token."""
    namespace, _, name = entity.node.rpartition("/")
    parts = ["@ros2_lv", str(dialect.domain()), entity.session, str(entity.node_id), str(entity.ident), entity.kind]
    parts += ["%", _mangle(namespace or "/"), name]
    if entity.kind != "NN":
        parts += [_mangle(entity.topic), dds_name(entity.type), entity.type_hash, qos_text(entity.qos)]
    return "/".join(parts)


def read_token(key: str) -> Entity | None:
    """Return the entity of a key from `token` or rmw_zenoh; None for any other key or another domain.

    Further parts that a newer rmw_zenoh may add at the end are ignored.
    """
    parts = key.split("/")
    if len(parts) < _NODE_PARTS or parts[0] != "@ros2_lv" or parts[5] not in KINDS or not all(parts):
        return None
    if parts[1] != str(dialect.domain()):
        return None
    _, _, session, node_id, ident, kind, _, namespace, name = parts[:_NODE_PARTS]
    if not (node_id.isdecimal() and ident.isdecimal()):
        return None
    whole = f"{_demangle(namespace).rstrip('/')}/{name}"
    node = Entity(KINDS[kind], whole, session, int(node_id), int(ident))
    if kind == "NN":
        return node
    return _read_endpoint(node, parts[_NODE_PARTS:_ENDPOINT_PARTS]) if len(parts) >= _ENDPOINT_PARTS else None


def _read_endpoint(node: Entity, parts: list[str]) -> Entity | None:
    topic, dds, type_hash, text = parts
    qos, type_name = read_qos(text), ros_name(_demangle(dds))
    if qos is None or not type_name:
        return None
    return node._replace(topic=_demangle(topic), type=type_name, type_hash=type_hash, qos=qos)


def qos_text(qos: Qos) -> str:
    """Return RELIABILITY:DURABILITY:HISTORY,DEPTH:deadline:lifespan:liveliness, the last three as defaults."""
    reliability = "" if qos.reliable else _BEST_EFFORT
    durability = _TRANSIENT_LOCAL if qos.latched else ""
    history = "" if qos.depth else _KEEP_ALL
    depth = "" if qos.depth in (0, _DEFAULT_DEPTH) else str(qos.depth)
    return f"{reliability}:{durability}:{history},{depth}:,:,:,,"


def read_qos(text: str) -> Qos | None:
    """Return the QoS in a text of `qos_text`; None for any other text."""
    fields = text.split(":")
    history, _, depth = fields[2].partition(",") if len(fields) >= 6 else ("", "", "none")
    if depth and not depth.isdecimal():
        return None
    depth_stored = 0 if history == _KEEP_ALL else int(depth or _DEFAULT_DEPTH)
    return Qos(fields[0] != _BEST_EFFORT, fields[1] == _TRANSIENT_LOCAL, depth_stored)


def ros_name(dds: str) -> str:
    """Return sensor_msgs/msg/Imu for sensor_msgs::msg::dds_::Imu_; "" for any other form."""
    parts = dds.split("::")
    if len(parts) != 4 or parts[2] != "dds_" or not parts[3].endswith("_"):
        return ""
    return f"{parts[0]}/{parts[1]}/{parts[3][:-1]}"


class Declarer(Protocol):
    """The part of the session that a node needs."""

    @property
    def zid(self) -> str:
        """Zenoh id of the session."""

    def declare_token(self, key: str) -> Callable[[], None]:
        """Declare a liveliness token; it lives until the returned function is called or the session is lost."""


class Node:
    """A node of ours in the graph, with the name `name` ("uuv1"). Declares itself, and its endpoints on request.

    It exists until `leave` or the end of the session. A process that acts for a node of another process passes that
    node's `identity` as `of`: it then declares endpoints of that node, and no second node of the same name.
    """

    def __init__(self, session: Declarer, name: str, of: Identity | None = None) -> None:
        self._session = session
        self._withdraw: list[Callable[[], None]] = []
        if of:
            self._node, self._first = Entity("NN", f"/{name}", *of, of[1]), ELSEWHERE
            return
        number = next(_numbers)
        self._node, self._first = Entity("NN", f"/{name}", session.zid, number, number), 0
        self._declare(self._node)

    @property
    def identity(self) -> Identity:
        """Identity of the node in the graph."""
        return self._node.session, self._node.node_id

    def leave(self) -> None:
        """Withdraw the node and its endpoints."""
        for withdraw in self._withdraw:
            withdraw()
        self._withdraw.clear()

    def publishes(self, topic: Topic, owner: str) -> bytes:
        """Declare that this node publishes this topic of the node `owner`, which may be itself; return the gid."""
        return gid_of(self._endpoint("MP", topic.full_name(owner), topic.type, topic.qos))

    def joins(self, publisher: Entity) -> None:
        """Declare that this node subscribes to the topic of that publisher, of whatever type."""
        self._endpoint("MS", publisher.topic, publisher.type, publisher.qos, publisher.type_hash)

    def subscribes(self, topic: Topic, owner: str) -> None:
        """Declare that this node subscribes to this topic of the node `owner`."""
        self._endpoint("MS", topic.full_name(owner), topic.type, topic.qos)

    def serves(self, name: str, type_name: str) -> None:
        """Declare that this node serves the service with that full name."""
        self._endpoint("SS", name, type_name, SERVICE_QOS)

    def calls(self, name: str, type_name: str) -> None:
        """Declare that this node is a client of the service with that full name."""
        self._endpoint("SC", name, type_name, SERVICE_QOS)

    def _endpoint(self, kind: Kind, name: str, type_name: str, qos: Qos, type_hash: str = "") -> str:
        ident, type_hash = self._first + next(_numbers), type_hash or hash_of(type_name)
        return self._declare(
            self._node._replace(kind=kind, ident=ident, topic=name, type=type_name, type_hash=type_hash, qos=qos)
        )

    def _declare(self, entity: Entity) -> str:
        """Declare the token of an entity, and return it."""
        key = token(entity)
        self._withdraw.append(self._session.declare_token(key))
        return key


def _mangle(name: str) -> str:
    return name.replace("/", "%")


def _demangle(name: str) -> str:
    return name.replace("%", "/")
