"""Show the other vehicles of a fleet to imaging sensors, as solid hulls at the positions that their slaves publish.

Their states come on the topic `ground_truth`: from the router if there is one, else from each slave. Between two
messages a hull is extrapolated at constant velocity; a vehicle that publishes nothing for `MAX_AGE_NS` is not shown.
Only the imaging process does this. Sensors in the loop (laser, profiler, scanning sonar) see the world alone, because
a recorded run has to be repeatable from the slave's own inputs. Not modelled: collisions between vehicles. With TLS no
other vehicle is shown, because a slave then accepts masters only, not other slaves.
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
from sim.vehicle.vehicle import Vehicle, load_vehicle

MAX_AGE_NS = NS_PER_S
QUEUE = 4
_ABSENT = (0.0, 0.0, 1e6)  # m, NED: below every seabed
_FARTHEST = 1e5  # m


class Neighbours:
    """The other vehicles of `scenario`'s fleet, which are like `vehicle` unless their member says otherwise.

    `states` maps node names to states.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle) -> None:
        self._scenario = scenario
        others = [member for member in scenario.member if member.node != scenario.slave.node]
        self._endpoints = [member.listen for member in others]
        self._solids = {
            member.node: hull(load_vehicle(member.vehicle)[0] if member.vehicle else vehicle) for member in others
        }
        self._received: dict[str, tuple[int, OdometrySample]] = {}  # node -> receive time (monotonic ns), sample
        self.states = {member.node: State(_ABSENT) for member in others}

    def stand_before(self, sensor: Any) -> None:
        """Add the hulls to a sensor's scene, unless the sensor, for example a user's own, has no `add`."""
        if hasattr(sensor, "add"):
            for node, state in self.states.items():
                sensor.add(self._solids[node], state)

    def subscribe(self) -> AbstractContextManager[Any]:
        """Subscribe to the states until the context is left. Raises NetworkError if a required router is missing."""
        network = self._scenario.network
        if self._scenario.security or not self.states:
            return nullcontext()
        session = open_master_session(*([network.router] if network.router else self._endpoints), network=network)
        for node in self.states:
            session.subscribe(node, TOPICS["ground_truth"].name, self._store_samples(node), QUEUE)
        return session

    def place_hulls(self, instant_ns: int) -> None:
        """Move each hull to its position at this monotonic time (ns). Ages count from receipt; clocks may differ."""
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
    """Return whether the sample is plausible: finite, near this world, with a unit quaternion."""
    near = all(abs(x) < _FARTHEST for x in (*sample.position, *sample.nu))  # also no nan
    size = sum(x * x for x in sample.orientation)
    return near and isfinite(size) and abs(size - 1.0) < 0.1
