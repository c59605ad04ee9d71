"""Record what a person did to a vehicle (set its pose, failed a thruster), so that a check can repeat it.

Each event is a message of the topic "events", in JSON, with the number of the step before which it happened:

    {"step": 812, "place": [[4.0, 4.0, 2.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]]}
    {"step": 905, "fail": [{"thruster": "bow", "kind": "off", ...}]}

A number in JSON has as many digits as Python needs to read the same number again.
"""

import json
from collections.abc import Iterable, Sequence
from typing import Any

from hil.common.errors import ConfigError
from hil.ros import message as ros_message
from hil.ros.topics import Topic
from sim.simulation import Simulation
from sim.vehicle.failures import Failure

# Only in recordings, as is the topic "pulses".
EVENTS = Topic("events", "std_msgs/msg/String", 0, "data")


def encode_place(step: int, position: Sequence[float], quaternion: Sequence[float], nu: Sequence[float]) -> bytes:
    """Encode a new state: position (NED, m), attitude (body to world), velocity `nu` (FRD, m/s and rad/s)."""
    return _encode({"step": step, "place": [list(position), list(quaternion), list(nu)]})


def encode_failures(step: int, failures: Iterable[Failure]) -> bytes:
    """Encode that thrusters were made to fail, or repaired."""
    return _encode({"step": step, "fail": [failure._asdict() for failure in failures]})


def decode_event(data: bytes) -> dict[str, Any]:
    """Return an encoded event as a dict; empty if it is malformed."""
    message = ros_message.decode(EVENTS.type, data)
    try:
        event = json.loads(message["data"]) if message else {}
    except ValueError:
        return {}
    return event if isinstance(event, dict) and isinstance(event.get("step"), int) else {}


def repeat(event: dict[str, Any], simulation: Simulation) -> None:
    """Apply an event to the simulation, as `hil.slave.loop.Loop` did. Raises ConfigError for an invalid event."""
    try:
        if "place" in event:
            simulation.place(*event["place"])
        simulation.fail(*[Failure(**failure) for failure in event.get("fail", ())])
    except (TypeError, ValueError):
        raise ConfigError(f"the recorded event {event} is damaged; repeat another recording") from None


def _encode(event: dict[str, Any]) -> bytes:
    return ros_message.encode(EVENTS.type, {"data": json.dumps(event)})
