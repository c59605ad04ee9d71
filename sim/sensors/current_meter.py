"""A current meter: the velocity of the water relative to the vehicle."""

from collections.abc import Sequence
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from hil.common.vectors import Vector3
from sim.dynamics import State
from sim.rotations import rotate_inverse
from sim.sensors.error import ErrorModel, sensor_random
from sim.sensors.extra_samples import VelocitySample
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene
from sim.sensors.surface import submersion
from sim.twins import make_error_bank


class CurrentMeterModel(NamedTuple):
    """Rate in Hz (0: none) and error of each component.

    Nortek Aquadopp (data sheet): 1 % of the measured value, and 0.5 cm/s; the rate is our choice.
    """

    rate: Annotated[float, Range(0.0, 100.0, "Hz")] = 4.0
    velocity: ErrorModel = ErrorModel(noise=0.005, scale=0.01)


class CurrentMeter:
    """One meter: the velocity of the water relative to it, along its own axes; nothing while it is in the air.

    Not modelled: water that the vehicle drags along, the jets of its thrusters.
    """

    Model = CurrentMeterModel
    topic = "current_meter"

    def __init__(self, model: CurrentMeterModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        self._mounting = mounting
        self._scene = scene
        self._errors = make_error_bank([model.velocity] * 3, 1.0 / model.rate, sensor_random(seed, self.topic))

    def sample(self, time_ns: int, state: State) -> VelocitySample | None:
        """Return the measurement of `state`."""
        position = self._mounting.world_position(state)
        relative = relative_flow(self._mounting, state, self._scene.flow_at(position))
        x, y, z = self._errors.measure(relative)
        return VelocitySample(time_ns, (x, y, z)) if submersion(self._scene, time_ns, position) > 0.0 else None


def relative_flow(mounting: Mounting, state: State, flow: Sequence[float]) -> Vector3:
    """Return the velocity of water that moves with `flow` (m/s, NED) relative to a sensor, along the sensor's axes."""
    x, y, z = rotate_inverse(state.quaternion, flow)
    u, v, w = mounting.velocity(state.nu)
    return rotate_inverse(mounting.quaternion, (x - u, y - v, z - w))
