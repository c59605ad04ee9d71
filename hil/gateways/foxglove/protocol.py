"""Messages of Foxglove's websocket protocol, version 1: JSON, and binary ones for what comes often.

https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md
"""

import json
from collections.abc import Mapping
from struct import Struct
from typing import Any, NamedTuple

SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
CDR = "cdr"
MESSAGE_DATA, SERVICE_RESPONSE = 1, 3  # opcodes of the server
CLIENT_MESSAGE, SERVICE_REQUEST = 1, 2  # of the client
WARNING, ERROR = 1, 2  # levels of a status

_MESSAGE = Struct("<BIQ")
_CLIENT = Struct("<BI")
_SERVICE = Struct("<BIII")


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
    return _MESSAGE.pack(MESSAGE_DATA, subscription, time_ns) + data


def encode_response(request: ServiceRequest, data: bytes) -> bytes:
    """Return the response to a call, in the encoding of the request."""
    encoding = request.encoding.encode()
    return _SERVICE.pack(SERVICE_RESPONSE, request.service, request.call, len(encoding)) + encoding + data


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
