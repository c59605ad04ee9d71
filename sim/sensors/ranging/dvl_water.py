"""Water track of a Doppler velocity log: velocity relative to a layer of water below the vehicle."""

from math import nan
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from sim.dynamics import State
from sim.rotations import rotate
from sim.sensors.current_meter import relative_flow
from sim.sensors.error import ErrorModel, sensor_random
from sim.sensors.mounting import Mounting
from sim.sensors.samples import DvlSample, Scene
from sim.sensors.surface import submersion
from sim.twins import make_error_bank

_MAX_DEPTH_SHARE = 0.8  # of the height above the seabed: below, the seabed's echo masks that of the water

Metres = Annotated[float, Range(0.1, 200.0, "m")]


class DvlWaterModel(NamedTuple):
    """Rate in Hz (0: none), near and far end of the layer (m from the sensor), error of each component.

    Noise: the 3.5 mm/s of the Teledyne Pathfinder as set in the LRAUV simulation (OSRF). The layer is our choice.
    """

    rate: Annotated[float, Range(0.0, 100.0, "Hz")] = 8.0
    near: Metres = 1.0
    far: Metres = 4.0
    velocity: ErrorModel = ErrorModel(noise=0.0035)

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        return "near is not below far" if self.near >= self.far else None


class DvlWater:
    """Water track of a Doppler velocity log: the velocity of the sensor relative to the water in the middle of a layer.

    The velocity (m/s) is along the sensor's axes. The track is locked while the sensor is under water and points
    downwards, and the layer ends within 80 % of the height above the seabed (Teledyne Pathfinder Guide 2018, Water
    Tracking). Not modelled: the single beams, differences of the flow within the layer.
    """

    Model = DvlWaterModel
    topic = "dvl_water"

    def __init__(self, model: DvlWaterModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        self._far = model.far
        self._middle = 0.5 * (model.near + model.far)
        self._mounting = mounting
        self._scene = scene
        self._errors = make_error_bank([model.velocity] * 3, 1.0 / model.rate, sensor_random(seed, self.topic))

    def sample(self, time_ns: int, state: State) -> DvlSample:
        """Return the measurement of `state`: velocity without altitude; all nan if the track is not locked."""
        position = self._mounting.world_position(state)
        axis = rotate(self._mounting.attitude(state), (0.0, 0.0, 1.0))
        flow = self._scene.flow_at([at + self._middle * along for at, along in zip(position, axis, strict=True)])
        u, v, w = self._errors.measure([-x for x in relative_flow(self._mounting, state, flow)])
        height, down = self._scene.world.seabed(position[0], position[1]) - position[2], axis[2]
        is_locked = down > 0.0 and self._far * down <= _MAX_DEPTH_SHARE * height
        if not is_locked or submersion(self._scene, time_ns, position) <= 0.0:
            return DvlSample(time_ns, (nan, nan, nan), nan, False)
        return DvlSample(time_ns, (u, v, w), nan, True)
