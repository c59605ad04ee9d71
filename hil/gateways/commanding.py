"""Requests of a Foxglove client that has the token: publish commands, call services, read and set parameters."""

from collections.abc import Mapping, Sequence
from typing import Any

from hil.client.fleet import Fleet
from hil.client.parameters import read_parameters, set_parameter
from hil.client.vehicle_handle import Vehicle
from hil.common.errors import ConfigError, NetworkError
from hil.common.text import json_text
from hil.gateways.foxglove.protocol import CDR, JSON
from hil.gateways.values import from_json, parse_json, to_json
from hil.network.services import call
from hil.recording.mcap_file import schema_of
from hil.ros import graph
from hil.ros import message as ros_message
from hil.ros.topics import COMMANDS, DESCRIPTIONS, TOPICS

LARGEST = 8192  # bytes of a command or a request


class Commanding:
    """Commands the vehicles of `fleet` in the name of a client. Methods wait for the vehicle; they raise HilError.

    Nothing is repeated: when a client publishes no more, the vehicle's deadman sets its thrusters to neutral.
    """

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet

    def publish(self, topic: str, data: bytes, encoding: str = CDR) -> None:
        """Send a command, in CDR or JSON, on a topic such as "/uuv1/cmd_vel"."""
        _, node, name = [*topic.split("/", 2), "", ""][:3]
        if name not in COMMANDS:
            raise ConfigError(f"{topic!r}: a vehicle takes commands on /NAME/ with {', '.join(COMMANDS)}")
        if len(data) > LARGEST:
            raise ConfigError(f"{topic}: {len(data)} bytes; a command has at most {LARGEST}")
        vehicle = self._vehicle(node)
        reason = vehicle.client.unavailable_reason()
        if reason:
            raise NetworkError(reason)
        if encoding == JSON:
            data = ros_message.encode(TOPICS[name].type, from_json(TOPICS[name].type, parse_json(data, topic)))
        vehicle.client.send(name, data)

    def entities(self) -> list[graph.Entity]:
        """Return the nodes that are there now, and what they publish, subscribe to, answer and call."""
        keys: list[str] = []
        for name in self._fleet.names[:1]:  # all are on one session
            keys = self._vehicle(name).client.session.tokens(graph.ALL)
        return [entity for key in keys if (entity := graph.read_token(key))]

    def subscribe(self, topic: str) -> None:
        """Declare in the graph a subscriber of a vehicle's topic: what describes the vehicle is made then."""
        _, node, name = [*topic.split("/", 2), "", ""][:3]
        if name in DESCRIPTIONS and node in self._fleet.names:
            self._vehicle(node).client.announce(name)

    def services(self) -> dict[str, str]:
        """Return the services that vehicles answer now, and their types."""
        types = {entity.topic: entity.type for entity in self.entities() if entity.kind == "SS"}
        return {name: kind for name, kind in types.items() if schema_of(f"{kind}_Request")[0]}

    def describe(self, name: str, kind: str) -> dict[str, Any]:
        """Return a service as `advertiseServices` has it."""
        halves: dict[str, Any] = {}
        for half in ("Request", "Response"):
            encoding, text = schema_of(f"{kind}_{half}")
            halves[half.lower()] = {
                "encoding": CDR,
                "schemaName": f"{kind}_{half}",
                "schemaEncoding": encoding,
                "schema": text.decode(),
            }
        return {"name": name, "type": kind, **halves}

    def call(self, name: str, kind: str, request: bytes, encoding: str = CDR) -> bytes:
        """Call a service with a request in CDR or JSON; its response in the same."""
        if len(request) > LARGEST:
            raise ConfigError(f"{name}: {len(request)} bytes; a request has at most {LARGEST}")
        if encoding == JSON:
            values = from_json(f"{kind}_Request", parse_json(request, name))
        elif (decoded := ros_message.decode(f"{kind}_Request", request)) is not None:
            values = decoded
        else:
            raise ConfigError(f"{name}: the request is not a {kind}_Request")
        vehicle = self._vehicle(name.split("/")[1])
        response = call(vehicle.client.session, name, kind, values)
        if encoding == JSON:
            return json_text(to_json(f"{kind}_Response", response)).encode()
        return ros_message.encode(f"{kind}_Response", response)

    def parameters(self, names: Sequence[str] = ()) -> dict[str, Any]:
        """Return parameters as "/uuv1/gains.surge.p" and values; all without `names`."""
        by_name: dict[str, Any] = {}
        for node in self._fleet.names:
            wanted = [name.removeprefix(f"/{node}/") for name in names] if names else None
            values = read_parameters(self._vehicle(node).client.session, node, wanted)
            by_name |= {f"/{node}/{name}": value for name, value in values.items()}
        return by_name

    def set_parameters(self, values: Mapping[str, Any]) -> None:
        """Set parameters by their names as above. Raises ConfigError with the reason of the first that is refused."""
        for name, value in values.items():
            _, node, plain = [*name.split("/", 2), "", ""][:3]
            if reason := set_parameter(self._vehicle(node).client.session, node, plain, value):
                raise ConfigError(f"{name}: {reason}")

    def _vehicle(self, node: str) -> Vehicle:
        if node not in self._fleet.names:
            raise NetworkError(f"no vehicle is called {node!r}; here: {', '.join(self._fleet.names) or 'none'}")
        return self._fleet.wait_for(node, seconds=2.0)[0]
