"""Store the samples of a vehicle's sensors once a second during a dive, for the report."""

from typing import Any, NamedTuple

from hil.client.client import VehicleClient
from hil.common.clock import NS_PER_S, now_ns
from hil.ros.diagnostics import Diagnostics
from hil.scenario.config import Scenario
from sim.sensors.samples import OdometrySample

PERIOD_NS = NS_PER_S
CAMERA, SONAR = "camera/image_raw", "forward_sonar/image"
TOPICS = ("ground_truth", "altimeter", CAMERA, SONAR)


class Observation(NamedTuple):
    """The newest samples at one time: `time` s after the first observation, true state, `altitude` m, and pictures."""

    time: float
    truth: OdometrySample
    altitude: float
    camera: Any
    sonar: Any


class DiveWatch:
    """Observer of the vehicle of `scenario`, which stores `observations`. A context manager. Raises NetworkError."""

    def __init__(self, scenario: Scenario) -> None:
        slave = scenario.slave
        self._client = VehicleClient(
            slave.listen,
            slave.node,
            role="observer",
            network=scenario.network,
            security=scenario.security,
            topics=TOPICS,
        )
        self._due_ns = self._began_ns = 0
        self.observations: list[Observation] = []

    def __enter__(self) -> "DiveWatch":
        return self

    def __exit__(self, *_: object) -> None:
        self._client.close()

    def observe(self) -> bool:
        """Store the newest samples if the period has passed; return whether any have been stored."""
        latest, now = self._client.latest, now_ns()
        if now < self._due_ns or not all(topic in latest for topic in TOPICS):
            return bool(self.observations)
        self._began_ns = self._began_ns or now
        self._due_ns = now + PERIOD_NS
        truth, altimeter, camera, sonar = (latest[topic].value for topic in TOPICS)
        self.observations.append(
            Observation((now - self._began_ns) / NS_PER_S, truth, altimeter.distance, camera, sonar)
        )  # fmt: skip
        return True

    def diagnostics(self) -> Diagnostics:
        """Return the newest diagnostics of the slave."""
        return self._client.diagnostics()
