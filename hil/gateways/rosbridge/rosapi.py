"""The services below /rosapi that clients of rosbridge ask about topics, types, services, nodes and parameters."""

from collections.abc import Callable, Mapping
from typing import Any

from hil.common.clock import now_ns, to_wall_ns
from hil.common.errors import ConfigError
from hil.common.text import json_text
from hil.gateways.commanding import Commanding
from hil.gateways.values import parse_json, whole_type
from hil.ros import dialect, types
from hil.ros.types import PRIMITIVES, definition

PREFIX = "/rosapi/"
COMMANDS = (f"{PREFIX}set_param",)  # only for clients with the token
Answer = dict[str, Any]


class RosApi:
    """Answers from what is in the graph now, and from `received_types`: topics with messages, and their types."""

    def __init__(self, commanding: Commanding, received_types: Mapping[str, str]) -> None:
        self._commanding = commanding
        self._received_types = received_types
        self._answers: dict[str, Callable[[Mapping[str, Any]], Answer]] = {
            "topics": lambda _: self._topics(),
            "topics_and_raw_types": lambda _: self._raw_types(),
            "topic_type": lambda of: {"type": self._types(("MP", "MS")).get(text(of, "topic"), "")},
            "topics_for_type": lambda of: {"topics": names_of(self._types(("MP", "MS")), text(of, "type"))},
            "services": lambda _: {"services": sorted(self._types(("SS",)))},
            "service_type": lambda of: {"type": self._types(("SS",)).get(text(of, "service"), "")},
            "services_for_type": lambda of: {"services": names_of(self._types(("SS",)), text(of, "type"), "srv")},
            "nodes": lambda _: {"nodes": sorted({entity.node for entity in commanding.entities()})},
            "node_details": self._node,
            "publishers": lambda of: {"publishers": self._who("MP", text(of, "topic"))},
            "subscribers": lambda of: {"subscribers": self._who("MS", text(of, "topic"))},
            "message_details": lambda of: {"typedefs": typedefs(whole_type(text(of, "type")))},
            "service_request_details": lambda of: {"typedefs": typedefs(f"{service_type(of)}_Request")},
            "service_response_details": lambda of: {"typedefs": typedefs(f"{service_type(of)}_Response")},
            "get_param_names": lambda _: {"names": sorted(self._parameters())},
            "get_param": self._get_parameter,
            "set_param": self._set_parameter,
            "has_param": lambda of: {"exists": parameter(of) in self._parameters()},
            "action_servers": lambda _: {"action_servers": []},
            "get_time": lambda _: {"time": time_now()},
            "get_ros_version": lambda _: {"version": 2, "distro": dialect.release()},
        }

    def call(self, name: str, given: Any) -> Answer:
        """Return the response of the service below /rosapi. Raises ConfigError, NetworkError."""
        answer = self._answers.get(name)
        if answer is None:
            raise ConfigError(f"{PREFIX}{name[:60]} is not here; there are: {', '.join(sorted(self._answers))}")
        return answer(given if isinstance(given, dict) else {})

    def type_of(self, topic: str) -> str:
        """Return the type of a topic; "" for an unknown one."""
        return self._received_types.get(topic) or self._types(("MP", "MS")).get(topic, "")

    def _types(self, kinds: tuple[str, ...]) -> dict[str, str]:
        found = dict(self._received_types) if "MP" in kinds else {}
        return found | {entity.topic: entity.type for entity in self._commanding.entities() if entity.kind in kinds}

    def _topics(self) -> Answer:
        found = sorted(self._types(("MP", "MS")).items())
        return {"topics": [name for name, _ in found], "types": [kind for _, kind in found]}

    def _raw_types(self) -> Answer:
        answer = self._topics()
        return answer | {"typedefs_full_text": [raw_type(kind) for kind in answer["types"]]}

    def _node(self, of: Mapping[str, Any]) -> Answer:
        mine = [entity for entity in self._commanding.entities() if entity.node == text(of, "node")]
        names = (("subscribing", "MS"), ("publishing", "MP"), ("services", "SS"))
        return {key: sorted({entity.topic for entity in mine if entity.kind == kind}) for key, kind in names}

    def _who(self, kind: str, topic: str) -> list[str]:
        entities = self._commanding.entities()
        return sorted({entity.node for entity in entities if (entity.kind, entity.topic) == (kind, topic)})

    def _parameters(self) -> dict[str, Any]:
        values = self._commanding.parameters()
        return {f"{node}:{rest}": value for name, value in values.items() for node, rest in (split(name),)}

    def _get_parameter(self, of: Mapping[str, Any]) -> Answer:
        values = self._parameters()
        return {"value": json_text(values[parameter(of)]) if parameter(of) in values else text(of, "default")}

    def _set_parameter(self, of: Mapping[str, Any]) -> Answer:
        value = parse_json(text(of, "value").encode(), "value")
        self._commanding.set_parameters({parameter(of).replace(":", "/"): value})
        return {"successful": True, "reason": ""}


def parameter(of: Mapping[str, Any]) -> str:
    """Return the name of a parameter, "/uuv1:gains.surge.p", also of "/uuv1/gains.surge.p"."""
    name = text(of, "name")
    return name if ":" in name else ":".join(split(name))


def split(name: str) -> tuple[str, str]:
    """Return "/uuv1" and "gains.surge.p" of "/uuv1/gains.surge.p"."""
    node, _, rest = name.rpartition("/")
    return node, rest


def text(of: Mapping[str, Any], name: str) -> str:
    """Return a text of a request; "" where there is none."""
    value = of.get(name, "")
    return value if isinstance(value, str) else ""


def names_of(types_by_name: Mapping[str, str], type_name: str, kind: str = "msg") -> list[str]:
    """Return the names that are of a type."""
    return sorted([name for name, each in types_by_name.items() if each == whole_type(type_name, kind)])


def raw_type(kind: str) -> str:
    """Return the whole definition of a type; "" for one that is not known."""
    try:
        return types.full_text(kind)
    except ConfigError:
        return ""


def time_now() -> Answer:
    """Return the time, by the names of ROS 2 and ROS 1."""
    seconds, nanoseconds = divmod(to_wall_ns(now_ns()), 1_000_000_000)
    return {"sec": seconds, "nanosec": nanoseconds, "secs": seconds, "nsecs": nanoseconds}


def service_type(of: Mapping[str, Any]) -> str:
    """Return the type of service in a request, "std_srvs/srv/SetBool"."""
    return whole_type(text(of, "type"), "srv")


def typedefs(name: str) -> list[Answer]:
    """Return a type and all that it is made of, as rosapi/TypeDef. Raises ConfigError for an unknown one.

    The length of an array is -1 where there is none, 0 where it may be any.
    """
    waiting, described = [name], dict[str, Answer]()
    while waiting:
        each = waiting.pop(0)
        if each in described:
            continue
        fields = definition(each).fields
        waiting += [field.type for field in fields if field.type not in PRIMITIVES]
        examples = {field.type: "0" if field.type in PRIMITIVES else "{}" for field in fields}
        examples |= {"string": "", "bool": "False"}
        described[each] = {
            "type": each, "fieldnames": [field.name for field in fields],
            "fieldtypes": [field.type for field in fields],
            "fieldarraylen": [-1 if field.length is None else field.length for field in fields],
            "examples": [examples[field.type] if field.length is None else "[]" for field in fields],
            "constnames": [], "constvalues": [],
        }  # fmt: skip
    return list(described.values())
