"""Place the other vehicles of a fleet as solid hulls in front of imaging sensors, where their slaves report them.

Their states come on the topic `ground_truth`, over the router if there is one, else from each slave; between two words
they go on as they went. Who says nothing for a while is not to be seen. Only the process of the pictures knows them:
what the loop senses for itself (laser, profiler, scanning sonar) is the world alone, as a run is repeated from what its
slave was told. Not modelled: that vehicles bump into each other. Under TLS none is heard, as a slave then obeys and
answers masters, not other slaves.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from math import isfinite
from typing import Any

from hil.common.clock import NS_PER_S, now_ns
from hil.network.roles import open_master_session
from hil.ros.encoders import decode_odometry
from hil.ros.topics import TOPICS
from hil.scenario.config import Scenario
from sim.dynamics import State
from sim.rays.solids import hull
from sim.rotations import integrate, rotate
from sim.sensors.samples import OdometrySample
from sim.vehicle.vehicle import Vehicle

MAX_AGE_NS = NS_PER_S
QUEUE = 4
_ABSENT = (0.0, 0.0, 1e6)  # m, NED: below every seabed
_FARTHEST = 1e5  # m


class Neighbours:
    """The other members of `scenario`: each a `vehicle` with a state, by the name of its node."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle) -> None:
        self._scenario = scenario
        others = [member for member in scenario.member if member.node != scenario.slave.node]
        self._endpoints = [member.listen for member in others]
        self._solid = hull(vehicle)
        self._received: dict[str, tuple[int, OdometrySample]] = {}  # when it came, and what
        self.states = {member.node: State(_ABSENT) for member in others}

    def stand_before(self, sensor: Any) -> None:
        """Add the hulls to a sensor's scene; one of a user's own may see no solids."""
        if hasattr(sensor, "add"):
            for state in self.states.values():
                sensor.add(self._solid, state)

    def subscribe(self) -> AbstractContextManager[Any]:
        """Subscribe to their states until the context is left. Raises NetworkError when a needed router is missing."""
        network = self._scenario.network
        if self._scenario.security or not self.states:
            return nullcontext()
        session = open_master_session(*([network.router] if network.router else self._endpoints), network=network)
        for node in self.states:
            session.subscribe(node, TOPICS["ground_truth"].name, self._store_samples(node), QUEUE)
        return session

    def place(self, instant_ns: int) -> None:
        """Place each hull where it is at this instant (monotonic ns), by when its state came: clocks need not agree."""
        for node, state in self.states.items():
            received_ns, sample = self._received.get(node, (0, None))
            if sample is None or abs(instant_ns - received_ns) > MAX_AGE_NS:
                state.position = list(_ABSENT)
                continue
            seconds = (instant_ns - received_ns) / NS_PER_S
            velocity = rotate(sample.orientation, sample.nu[:3])
            state.position = [x + speed * seconds for x, speed in zip(sample.position, velocity, strict=True)]
            state.quaternion = list(integrate(sample.orientation, sample.nu[3:], seconds))

    def _store_samples(self, node: str) -> Callable[[str, bytes, bytes], None]:
        def store(_topic: str, payload: bytes, _attachment: bytes) -> None:
            sample = decode_odometry(payload)
            if sample is not None and _is_somewhere(sample):
                self._received[node] = now_ns(), sample

        return store


def _is_somewhere(sample: OdometrySample) -> bool:
    """Return False for a place where no vehicle of this world can be."""
    near = all(abs(x) < _FARTHEST for x in (*sample.position, *sample.nu))  # also no nan
    size = sum(x * x for x in sample.orientation)
    return near and isfinite(size) and abs(size - 1.0) < 0.1
