"""A vehicle as a planner sees it: its newest samples, and commands to it."""

import threading
from typing import Any, NamedTuple

from hil.autonomy.control import VelocityCommand
from hil.clock import NS_PER_S, now_ns, to_wall_ns
from hil.errors import NetworkError
from hil.master.delay import DelayMeter
from hil.topics import TOPICS
from hil.transport import ros
from hil.transport.session import dial

QUEUE = 256  # messages that may wait for the reader; beyond it the oldest are dropped


class Stamped(NamedTuple):
    """A message and when it came (monotonic ns)."""

    value: Any
    received_ns: int

    @property
    def age_s(self) -> float:
        """Seconds since it came."""
        return (now_ns() - self.received_ns) / NS_PER_S


class VehicleClient:
    """One vehicle, over one session. Use as a context; leaving it stops the vehicle and closes the session.

    `latest` holds the newest message of each topic, in NED and FRD; `received` counts them; `malformed`
    counts what could not be decoded; `delays` measures the commands.
    """

    def __init__(self, endpoint: str, node: str) -> None:
        self.endpoint = endpoint
        self.node = node
        self.latest: dict[str, Stamped] = {}
        self.received = dict.fromkeys(TOPICS, 0)
        self.malformed = 0
        self.delays = DelayMeter()
        self.first_sample_wall_ns = 0
        self._first_sample = threading.Event()
        self._session = dial(endpoint)
        self.dialled_wall_ns = to_wall_ns(now_ns())
        self._commands = self._session.publisher(node, TOPICS["cmd_vel"])
        self._session.subscribe(node, "*", self._deliver, QUEUE)

    def __enter__(self) -> "VehicleClient":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Command standstill and close the session."""
        self.command(VelocityCommand())
        self._session.close()

    def command(self, command: VelocityCommand) -> int:
        """Send a velocity command (FRD, m/s, rad/s); its sequence number. `depth` and `heading` do not travel."""
        linear = (command.surge, command.sway, command.heave)
        payload = ros.encode_twist(linear, (0.0, 0.0, command.yaw_rate))
        return self._commands.put(payload, to_wall_ns(now_ns()))

    def wait_for_vehicle(self, seconds: float) -> bool:
        """Wait for the first sample; whether it came within `seconds`."""
        return self._first_sample.wait(seconds)

    def get(self, topic: str, within_s: float = 1.0) -> Any:
        """The newest message of a topic. Raises NetworkError if none came or it is older than `within_s`."""
        stamped = self.latest.get(topic)
        if stamped is None:
            raise NetworkError(f"{self.node} at {self.endpoint} has sent no {topic}")
        if stamped.age_s > within_s:
            raise NetworkError(f"{self.node} at {self.endpoint} is gone: no {topic} for {stamped.age_s:.1f} s")
        return stamped.value

    def diagnostics(self) -> dict[str, str]:
        """The slave's figures of health as it last published them; empty before the first."""
        stamped = self.latest.get("diagnostics")
        return stamped.value if stamped else {}

    def _deliver(self, topic: str, payload: bytes, attachment: bytes) -> None:
        received_ns = now_ns()
        decode = ros.decoder(topic)
        value = decode(payload) if decode else None
        if value is None:
            self.malformed += 1
            return
        self.received[topic] += 1
        if topic == "trace":
            self._trace(value, attachment, to_wall_ns(received_ns))
        elif topic == "diagnostics":
            value = value[0][3] if value else {}
            self.latest[topic] = Stamped(value, received_ns)
        else:
            self.latest[topic] = Stamped(value, received_ns)
            if not self.first_sample_wall_ns:
                self.first_sample_wall_ns = to_wall_ns(received_ns)
                self._first_sample.set()

    def _trace(self, instants: list[int], attachment: bytes, received_wall_ns: int) -> None:
        stamp = ros.unpack_attachment(attachment)
        if stamp is None:
            self.malformed += 1
            return
        self.delays.add(instants, stamp[1], received_wall_ns)
