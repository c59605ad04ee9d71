"""Waves computed in C (sim/native/waves.h). Loaded only for a world that has waves."""

from collections.abc import Sequence
from struct import pack

from sim.environment.ocean import Waves
from sim.environment.water import LEVEL, SampledWaves
from sim.environment.waves import POINT, Plan, WaterMotion, WaveField
from sim.environment.world import World
from sim.rotations import Rotation


class NativeWaveField(WaveField):
    """`WaveField` in C. Raises ImportError if it is not compiled.

    `hold_ns` and `half_sizes` (m) of the hull are for NativeSampledWaves.
    """

    def __init__(
        self,
        waves: Waves,
        depth: float,
        gravity: float,
        seed: int,
        hold_ns: int = 0,
        half_sizes: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        from sim.native._native import WaveField as Twin

        super().__init__(waves, depth, gravity, seed)
        numbers = self.numbers()
        self.twin = Twin(pack(f"{len(numbers)}d", *numbers), depth, hold_ns, half_sizes)

    def elevation(self, time: float, north: float, east: float) -> float:
        """Return the surface's elevation (m) as WaveField.elevation does."""
        return self.twin.elevation(time, north, east)

    @property
    def held(self) -> WaterMotion:
        """The motion of the last sample of NativeSampledWaves."""
        return WaterMotion(*self.twin.held)

    def surface(self, time: float, north: float, east: float) -> float:
        """Return the surface's elevation (m) as WaveField.surface does, from the last sample of NativeSampledWaves."""
        return self.twin.surface(time, north, east)

    def pressure_depth(self, time: float, north: float, east: float, depth: float) -> float:
        """Return the depth (m) of equal pressure as WaveField.pressure_depth does."""
        return self.twin.pressure_depth(time, north, east, depth)

    def motion(self, time: float, north: float, east: float, depth: float, *, plan: Plan = POINT) -> WaterMotion:
        """Return the water's motion as WaveField.motion does."""
        return WaterMotion(*self.twin.motion(time, north, east, depth, plan))


class NativeSampledWaves(SampledWaves):
    """`SampledWaves` in C. Raises ImportError if it is not compiled."""

    wave_field: NativeWaveField

    def _make_wave_field(self, waves: Waves, world: World, seed: int) -> WaveField:
        return NativeWaveField(waves, world.depth, world.gravity, seed, self._hold_ns, self._half_sizes)

    def motion(self, time_ns: int, position: Sequence[float], rotation: Rotation = LEVEL) -> WaterMotion:
        """Return the water's motion as SampledWaves.motion does."""
        return WaterMotion(*self.wave_field.twin.sampled_motion(time_ns, position, rotation))
