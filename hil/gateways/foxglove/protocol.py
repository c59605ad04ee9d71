"""Messages of Foxglove's websocket protocol, version 1: JSON, and binary ones for what comes often.

https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md
"""

import json
from collections.abc import Iterable, Mapping
from struct import Struct
from typing import Any, NamedTuple

from hil.ros.graph import Entity, Kind

SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
CDR, JSON = "cdr", "json"
MESSAGE_DATA, TIME, SERVICE_RESPONSE, ASSET = 1, 2, 3, 4  # opcodes of the server
CLIENT_MESSAGE, SERVICE_REQUEST = 1, 2  # of the client
WARNING, ERROR = 1, 2  # levels of a status

_MESSAGE = Struct("<BIQ")
_CLIENT = Struct("<BI")
_SERVICE = Struct("<BIII")
_TIME = Struct("<BQ")
_ASSET = Struct("<BIBI")
# Kinds of endpoints in the graph, and their names in `connectionGraphUpdate`.
_ENDPOINTS: dict[Kind, tuple[str, str]] = {
    "MP": ("publishedTopics", "publisherIds"),
    "MS": ("subscribedTopics", "subscriberIds"),
    "SS": ("advertisedServices", "providerIds"),
}

Graph = dict[Kind, dict[str, list[str]]]  # kind -> name of a topic or service -> its nodes


class Channel(NamedTuple):
    """A topic that is offered; `schema` is text, or base64 of a binary definition."""

    topic: str
    type: str
    encoding: str = CDR
    schema: str = ""
    schema_encoding: str = ""


class ClientMessage(NamedTuple):
    """A message that a client publishes on a channel of its own."""

    channel: int
    data: bytes


class ServiceRequest(NamedTuple):
    """A call of a service."""

    service: int
    call: int
    encoding: str
    data: bytes


def encode_text(op: str, **values: Any) -> str:
    """Return a JSON message."""
    return json.dumps({"op": op, **values})


def encode_channel(number: int, channel: Channel) -> dict[str, Any]:
    """Return a channel as `advertise` has it."""
    return {
        "id": number,
        "topic": channel.topic,
        "encoding": channel.encoding,
        "schemaName": channel.type,
        "schema": channel.schema,
        "schemaEncoding": channel.schema_encoding,
    }


def encode_message(subscription: int, time_ns: int, data: bytes) -> bytes:
    """Return a message for a subscription."""
    return _MESSAGE.pack(MESSAGE_DATA, subscription, max(0, time_ns)) + data


def encode_response(request: ServiceRequest, data: bytes) -> bytes:
    """Return the response to a call, in the encoding of the request."""
    encoding = request.encoding.encode()
    return _SERVICE.pack(SERVICE_RESPONSE, request.service, request.call, len(encoding)) + encoding + data


def encode_parameters(values: Mapping[str, Any], request_id: Any = None) -> str:
    """Return parameters, as an answer to the request with that id, or without one of their own."""
    listed = [
        {"name": name, "value": value} | ({"type": "float64"} if isinstance(value, float) else {})
        for name, value in values.items()
    ]
    return encode_text("parameterValues", parameters=listed, **({} if request_id is None else {"id": request_id}))


def encode_time(time_ns: int) -> bytes:
    """Return the server's time."""
    return _TIME.pack(TIME, max(0, time_ns))


def encode_asset(request: int, data: bytes, problem: str = "") -> bytes:
    """Return an asset, or the problem with it."""
    text = problem.encode()
    return _ASSET.pack(ASSET, request, bool(problem), len(text)) + text + data


def graph_of(entities: Iterable[Entity]) -> Graph:
    """Return the nodes of each topic and service."""
    graph: Graph = {kind: {} for kind in _ENDPOINTS}
    for entity in sorted(entities):
        nodes = graph.get(entity.kind, {}).setdefault(entity.topic, [])
        if entity.node not in nodes:
            nodes.append(entity.node)
    return graph


def encode_graph(before: Graph, now: Graph) -> str:
    """Return what has changed in the graph; "" if nothing has."""
    values: dict[str, Any] = {}
    for kind, (key, ids) in _ENDPOINTS.items():
        names = sorted(before[kind].keys() | now[kind].keys())
        values[key] = [
            {"name": name, ids: now[kind].get(name, [])}
            for name in names
            if before[kind].get(name) != now[kind].get(name)
        ]
    topics = (before["MP"].keys() | before["MS"].keys()) - (now["MP"].keys() | now["MS"].keys())
    gone = {"removedTopics": sorted(topics), "removedServices": sorted(before["SS"].keys() - now["SS"].keys())}
    return encode_text("connectionGraphUpdate", **values, **gone) if any(values.values()) else ""


def decode_text(text: str) -> Mapping[str, Any] | None:
    """Return a JSON message of a client; None if it is not one."""
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return message if isinstance(message, dict) and isinstance(message.get("op"), str) else None


def decode_binary(data: bytes) -> ClientMessage | ServiceRequest | None:
    """Return a binary message of a client; None if it is not one."""
    if len(data) >= _CLIENT.size and data[0] == CLIENT_MESSAGE:
        return ClientMessage(_CLIENT.unpack_from(data)[1], data[_CLIENT.size :])
    if len(data) >= _SERVICE.size and data[0] == SERVICE_REQUEST:
        _, service, call, length = _SERVICE.unpack_from(data)
        end = _SERVICE.size + length
        if end <= len(data):
            return ServiceRequest(service, call, data[_SERVICE.size : end].decode(errors="replace"), data[end:])
    return None
