"""The world around the vehicle, for instruments that measure when they are asked."""

from collections.abc import Callable
from functools import cached_property
from typing import Any

from hil.client.client import Stamped
from hil.common.clock import NS_PER_S
from hil.scenario.config import Scenario, build_simulation
from sim.dynamics import State
from sim.environment.world import load_world
from sim.rotations import integrate, rotate
from sim.sensors.mounting import Mounting
from sim.sensors.samples import OdometrySample, Sample, Sensor
from sim.sensors.sensor_set import SensorSpec
from sim.vehicle.vehicle import load_vehicle

STALE_NS = NS_PER_S  # a state that is older is none: the slave has stopped
TRUTH = "ground_truth"


class LiveWorld:
    """The scenario's world, loaded when it is needed, with the vehicle at the slave's newest true state.

    Between two states it moves on at constant velocity. `watch` subscribes to a topic. Waves have another phase than in
    the slave, as their time is not the slave's.
    """

    def __init__(self, scenario: Scenario, watch: Callable[[str], None]) -> None:
        self._scenario, self._watch = scenario, watch
        self.truth = TRUTH if TRUTH in scenario.sensors else "odom"
        self._newest: tuple[int, OdometrySample] | None = None

    def on_truth(self, stamped: Stamped) -> None:
        """Take a state of the vehicle."""
        self._newest = stamped.sent_ns, stamped.value

    def state(self, now_ns: int) -> State | None:
        """Return the true state at a monotonic time; None while none has come, or it is too old."""
        self._watch(self.truth)  # which does nothing from the second time on
        if self._newest is None or now_ns - self._newest[0] > STALE_NS:
            return None
        measured_ns, sample = self._newest
        seconds = (now_ns - measured_ns) / NS_PER_S
        velocity = rotate(sample.orientation, sample.nu[:3])
        position = [x + speed * seconds for x, speed in zip(sample.position, velocity, strict=True)]
        return State(position, integrate(sample.orientation, sample.nu[3:], seconds), sample.nu)

    @cached_property
    def simulation(self) -> Any:
        """The simulation, which is never stepped: its state is set before each measurement. Raises HilError."""
        vehicle, _ = load_vehicle(self._scenario.vehicle)
        return build_simulation(self._scenario.for_process({}), vehicle, load_world(self._scenario.world))


class Scene:
    """The world around the vehicle as one instrument sees it, if it measures when its client asks, by its settings.

    The state is the slave's true one, extrapolated to the time that is asked for. The world is loaded when the first
    sensor is built, so an instrument that only passes samples on costs no such memory. `spec` is its sensor.
    """

    def __init__(self, world: LiveWorld, spec: SensorSpec, seed: int) -> None:
        self._world, self._spec, self._seed = world, spec, seed
        self.state = world.state

    def build(self, model: Any = None, mounting: Mounting | None = None, sensor: type[Sensor] | None = None) -> Sensor:
        """Return the instrument's sensor with another record of keys, and mounted otherwise. May take a while.

        It may also be of another class, `sensor`, with a `model` of that. Keep what it returns: errors and the head of
        a scanning sonar go on from one measurement to the next.
        """
        kept = self._spec
        spec = SensorSpec(sensor or kept.sensor, model or kept.model, mounting or kept.mounting, kept.name)
        return spec.build(self._seed, self._world.simulation)

    def measure(self, sensor: Sensor, now_ns: int) -> Sample | None:
        """Return a sensor's measurement at a monotonic time; None without a state, or if the sensor gives none.

        The time of the sample is monotonic (ns).
        """
        state = self._world.state(now_ns)
        if state is None:
            return None
        simulation = self._world.simulation
        simulation.state.position, simulation.state.quaternion = state.position, state.quaternion
        simulation.state.nu, simulation.time_ns = state.nu, now_ns
        return sensor.sample(now_ns, simulation.state)
