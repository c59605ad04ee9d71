"""Store what a diving vehicle's sensors show every other second, for the report."""

from typing import Any, NamedTuple

from hil.client.client import VehicleClient
from hil.common.clock import NS_PER_S, now_ns
from hil.ros.diagnostics import Diagnostics
from hil.scenario.config import Scenario
from sim.sensors.samples import OdometrySample

PERIOD_NS = NS_PER_S
CAMERA, SONAR = "camera/image_raw", "forward_sonar/image"
SEEN = ("ground_truth", "altimeter", "laser", CAMERA, SONAR)


class Observation(NamedTuple):
    """One instant: s since the first, where the vehicle truly was, its altimeter (m), and its newest pictures."""

    time: float
    truth: OdometrySample
    altitude: float
    laser: Any
    camera: Any
    sonar: Any


class DiveWatch:
    """An observer of the vehicle of `scenario`, with its `observations`. Use as a context. Raises NetworkError."""

    def __init__(self, scenario: Scenario) -> None:
        slave = scenario.slave
        self._client = VehicleClient(
            slave.listen,
            slave.node,
            part="observer",
            network=scenario.network,
            security=scenario.security,
            topics=SEEN,
        )
        self._due_ns = self._began_ns = 0
        self.observations: list[Observation] = []

    def __enter__(self) -> "DiveWatch":
        return self

    def __exit__(self, *_: object) -> None:
        self._client.close()

    def observe(self) -> bool:
        """Store the newest samples if the period has passed; return whether there are any."""
        latest, now = self._client.latest, now_ns()
        if now < self._due_ns or not all(topic in latest for topic in SEEN):
            return bool(self.observations)
        self._began_ns = self._began_ns or now
        self._due_ns = now + PERIOD_NS
        truth, altimeter, laser, camera, sonar = (latest[topic].value for topic in SEEN)
        self.observations.append(
            Observation((now - self._began_ns) / NS_PER_S, truth, altimeter.distance, laser, camera, sonar)
        )  # fmt: skip
        return True

    def figures(self) -> Diagnostics:
        """Return the slave's last figures of health."""
        return self._client.diagnostics()
